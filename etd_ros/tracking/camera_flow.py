"""Moving objects before a moving camera, told from the flow of edges: what goes otherwise than the picture does.

The speed of an edge across itself is the slope of its events' times (Benosman et al. 2014, Event-Based Visual Flow).
One motion of the picture (shift, zoom and roll) that suits most edges, all over the sensor, is the camera's; where most
edges do not go with it, something moves by itself, and the motion that suits those is its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.tracking.clusters import Sighting, box_round
from etd_ros.tracking.discovery_kernels import Float64Array
from etd_ros.tracking.edge_flow_kernels import (
    BELOW,
    COLUMNS,
    NORMAL_X,
    NORMAL_Y,
    PARTS,
    PARTS_TURNING,
    RIGHT,
    SPEED,
    flows_of,
    motion_of,
)
from etd_ros.tracking.recent_events import RecentEvents

CAMERA_SPAN_S, CAMERA_FLOWS = 0.2, 4000
"""The camera's motion is told from the edges of so long, at most so many: in less time slow ones look too fast."""
OWN_SPAN_S, OWN_FLOWS = 0.1, 6000
"""What moves otherwise is looked for among newer ones, and more of them."""
FLOWS_MIN = 150
SPEED_MAX_PX_S = 1500.0
"""What comes along faster is noise, or light that changes."""
STRAY_PX_S, STRAY_SHARE = 15.0, 0.5
"""An edge goes with a motion whose speed across it is the edge's to this, and this share of it."""
CAMERA_SHARE = 0.5
"""The motion is the camera's if so many of the edges go with it ..."""
SURROUNDED, SURROUNDED_ON = 0.6, 0.3
"""... and if they surround so much of the sensor: what moves before a still camera, however large, leaves its rims
quiet (docs/starting.md). Less is enough for a camera that moved until now to move on."""
CELL_PX, BLOCK_CELLS = 8, 3
"""Edges are counted in cells, each together with those round it: blocks of so many cells' side."""
BLOCK_FLOWS_MAX = 12
"""The camera's motion is told from so many edges of a block: what is rich in edges counts by its area."""
BLOCK_GOING_MIN, BLOCK_GOING_SHARE = 3, 0.6
"""A block goes with the camera if so many of its edges do, and this share of them: noise does by chance."""
BLOCK_FLOWS_MIN, ODD_SHARE = 6, 0.7
"""A cell is odd if its block has so many edges and this share of them does not go with the camera."""
ODD_MIN = 25
"""Neighbouring odd cells with fewer such edges are no object."""
SUITED_MIN, SUITED_SHARE = 20, 0.5
"""Nor are they one if no motion suits so many, and this share, of them."""
DIFFERENCE_MIN_PX_S, DIFFERENCE_ERRORS = 20.0, 3.0
"""An object's velocity differs from the picture's there by this and by so many of its standard errors."""
TRIM = 0.02


@dataclass(frozen=True, slots=True)
class Motion:
    """How the picture moves: by (x, y) pixels/s in the middle of the sensor, and zoom and roll (1/s) about it."""

    x: float = 0.0
    y: float = 0.0
    zoom: float = 0.0
    roll: float = 0.0

    def at(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
        """The velocity (pixels/s) at places (pixels from the middle)."""
        return self.x + self.zoom * x - self.roll * y, self.y + self.zoom * y + self.roll * x


class CameraFlow:
    """Finds the camera's motion, and what moves otherwise, from the flow of edges.

    Args:
        events: where the events come from.

    Attributes:
        motion: the camera's at the last look; None if no motion suits most edges, all over the sensor.
    """

    def __init__(self, events: RecentEvents) -> None:
        self.motion: Motion | None = None
        self._events = events
        self._rows, self._columns = -(-events.height // CELL_PX), -(-events.width // CELL_PX)

    def look(self, surrounded: float = SURROUNDED) -> list[Sighting]:
        """What moves otherwise than the camera now; nothing where that is not known to move.

        Args:
            surrounded: the share of the sensor that the edges which move with the camera surround at least.
        """
        self.motion = self._camera_motion(surrounded)
        if self.motion is None:
            return []
        flows = self._flows(OWN_SPAN_S, OWN_FLOWS)
        odd = ~go_with(flows, self.motion)
        labels = self._groups(flows, odd)
        groups = (flows[odd & (labels == label)] for label in range(1, int(labels.max(initial=0)) + 1))
        sightings = (self._sighting(group, self.motion) for group in groups if len(group) >= ODD_MIN)
        return [sighting for sighting in sightings if sighting is not None]

    def _flows(self, span_s: float, most: int) -> Float64Array:
        """The flows of the edges of so long, their places from the sensor's middle, shape (n, COLUMNS)."""
        events = self._events
        flows = np.empty((most, COLUMNS))
        oldest_ns = events.stamp_ns - round(span_s * 1e9)
        sides = (0, events.height, 0, events.width)
        middle = (events.width / 2, events.height / 2)
        flows = flows[: flows_of(events.times_of_each, events.stamp_ns, oldest_ns, *sides, *middle, flows)]
        return flows[flows[:, SPEED] < SPEED_MAX_PX_S]

    def _camera_motion(self, surrounded: float) -> Motion | None:
        """The motion of most edges, if these surround such a share of the sensor."""
        flows = self._evenly(self._flows(CAMERA_SPAN_S, CAMERA_FLOWS))
        if len(flows) < FLOWS_MIN:
            return None
        parts = np.zeros(PARTS_TURNING)
        motion_of(flows, parts, np.zeros(PARTS_TURNING))
        motion = Motion(*parts.tolist())
        going = go_with(flows, motion)
        if going.mean() < CAMERA_SHARE:
            return None
        places = flows[self._are_among_alike(flows, going)][:, [RIGHT, BELOW]]
        return motion if surrounded_share(places, self._events) >= surrounded else None

    def _are_among_alike(self, flows: Float64Array, going: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
        """Which flows go along in blocks that do, shape (n,)."""
        blocks = self._blocks(flows)
        counts, going_counts = np.bincount(blocks), np.bincount(blocks, going)
        block_goes = (going_counts >= BLOCK_GOING_MIN) & (going_counts >= BLOCK_GOING_SHARE * counts)
        return np.asarray(going & block_goes[blocks], np.bool_)

    def _evenly(self, flows: Float64Array) -> Float64Array:
        """The flows without those that are more than BLOCK_FLOWS_MAX of a block's."""
        blocks = self._blocks(flows)
        order = np.argsort(blocks, kind="stable")
        _, firsts, counts = np.unique(blocks[order], return_index=True, return_counts=True)
        places = np.arange(len(flows)) - np.repeat(firsts, counts)
        # Every so many-th of a block's, which lie row by row.
        strides = np.repeat(-(-counts // BLOCK_FLOWS_MAX), counts)
        return np.asarray(flows[order[places % strides == 0]], np.float64)

    def _blocks(self, flows: Float64Array) -> npt.NDArray[np.int64]:
        """The number of each flow's block, shape (n,)."""
        columns, rows = (self._pixels(flows) // (BLOCK_CELLS * CELL_PX)).T
        return np.asarray(rows * self._columns + columns, np.int64)

    def _groups(self, flows: Float64Array, odd: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32]:
        """The number of each flow's group of neighbouring odd cells, from 1; 0 for none."""
        columns, rows = (self._pixels(flows) // CELL_PX).T
        cells = rows * self._columns + columns
        counts, odd_counts = (
            np.bincount(cells, weights, self._rows * self._columns).reshape(self._rows, self._columns)
            for weights in (None, odd.astype(np.float64))
        )
        in_block, odd_in_block = (
            cv2.boxFilter(
                each.astype(np.float64), -1, (BLOCK_CELLS, BLOCK_CELLS), normalize=False, borderType=cv2.BORDER_CONSTANT
            )
            for each in (counts, odd_counts)
        )
        is_odd = (counts > 0) & (in_block >= BLOCK_FLOWS_MIN) & (odd_in_block >= ODD_SHARE * in_block)
        _, labels = cv2.connectedComponents(is_odd.astype(np.uint8), connectivity=8)
        return np.asarray(labels.ravel()[cells], np.int32)

    def _pixels(self, flows: Float64Array) -> npt.NDArray[np.int64]:
        """The column and row of each flow's pixel, shape (n, 2)."""
        middle = (self._events.width / 2, self._events.height / 2)
        return np.asarray(np.floor(flows[:, [RIGHT, BELOW]] + middle), np.int64)

    def _sighting(self, group: Float64Array, camera: Motion) -> Sighting | None:
        """What moves as most flows of a group do, if one motion suits them and is not the camera's."""
        x, y = np.median(group[:, RIGHT]), np.median(group[:, BELOW])
        flows = group.copy()
        flows[:, RIGHT] -= x
        flows[:, BELOW] -= y
        parts, errors = np.zeros(PARTS), np.zeros(PARTS)
        motion_of(flows, parts, errors)
        own, error_px_s = Motion(*parts.tolist()), float(np.hypot(errors[0], errors[1]))
        camera_velocity = np.array(camera.at(np.array([x]), np.array([y])))[:, 0]
        difference = float(np.hypot(*(camera_velocity - (own.x, own.y))))
        suited = go_with(flows, own)
        if suited.sum() < max(SUITED_MIN, SUITED_SHARE * len(group)):
            return None
        if difference < max(DIFFERENCE_MIN_PX_S, DIFFERENCE_ERRORS * error_px_s):
            return None
        columns, rows = self._pixels(group[suited]).T
        # The newer of both polarities' events is the flow's, or came hardly later.
        times_ns = self._events.times_of_each[rows, columns].max(axis=1)
        ages_s = np.minimum((self._events.stamp_ns - times_ns) * 1e-9, OWN_SPAN_S)
        now_x, now_y = (columns + 0.5 + own.x * ages_s, rows + 0.5 + own.y * ages_s)
        box = box_round(now_x.astype(np.float32), now_y.astype(np.float32), TRIM)
        return Sighting(box, (own.x, own.y), error_px_s)


def surrounded_share(places: Float64Array, events: RecentEvents) -> float:
    """The share of the sensor that lies between places (pixels), shape (n, 2)."""
    if len(places) == 0:
        return 0.0
    return float(cv2.contourArea(cv2.convexHull(places.astype(np.float32)))) / (events.width * events.height)


def go_with(flows: Float64Array, motion: Motion) -> npt.NDArray[np.bool_]:
    """Whether each flow is that of an edge that moves with a motion (about the places' origin), shape (n,)."""
    x, y = motion.at(flows[:, RIGHT], flows[:, BELOW])
    speeds = flows[:, NORMAL_X] * x + flows[:, NORMAL_Y] * y
    return np.asarray(np.abs(flows[:, SPEED] - speeds) <= STRAY_PX_S + STRAY_SHARE * np.abs(speeds), np.bool_)
