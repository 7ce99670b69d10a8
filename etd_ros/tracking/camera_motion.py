"""Moving objects before a moving camera: the camera's motion is found, and what moves otherwise stands out.

The flow of edges (`camera_flow.py`) tells it where it is much the same for some tenths of a second. Otherwise motions
are tried out: the sensor is cut into tiles. For each velocity of a grid a tile's events are moved on by their ages, and
the chance that two of them fall on the same pixel says how well it fits (contrast maximisation, Gallego et al. 2018).
One motion (shift, zoom and roll) that fits most tiles is the camera's.
Where tiles side by side fit it badly, the velocity that fits them best is an object's, and each event near by tells
which of the two motions makes it fall on others.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.tracking.camera_flow import SURROUNDED, SURROUNDED_ON, CameraFlow, Motion, surrounded_share
from etd_ros.tracking.clusters import Sighting, box_round
from etd_ros.tracking.discovery_kernels import (
    Float32Array,
    Float64Array,
    X,
    Y,
    deal_to_tiles,
    draw,
    read_evidence,
    refined_velocity,
    score_tiles,
)
from etd_ros.tracking.recent_events import RecentEvents

TILE_PX = 24
CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))
TILE_EVENTS_MIN, TILE_EVENTS_MAX = 20, 48
"""Tiles with fewer events say nothing; of more, so many are looked at."""
REACH = 6
"""Velocities of the grid to each side of 0."""
STEP_PX = 1.25
"""Distance of the velocities (pixels of motion in the window)."""
WINDOW_MIN_S, WINDOW_MAX_S = 0.02, 0.08
WINDOW_PX = 5.0
"""The camera's motion in the window is about this (pixels)."""
TILES_MIN = 6
FITS = 0.7
"""A tile moves with the camera if its best velocity is hardly better: the camera's has this share of its score ..."""
STANDS_OUT = 0.45
"""... and it stands out if the camera's velocity has less than this share."""
CAMERA_SHARE = 0.3
"""The camera moves if so many of the tiles fit, and if they surround as much of the sensor as its edges have to."""
GROUPS_MAX = 8
"""Only so many groups of tiles that stand out are looked at, the largest."""
FIT_ROUNDS = 2
ZOOM_PRIOR = 4.0
"""How many tiles' worth of evidence zoom and roll have against them."""
DIFFERENCE_STEPS = 1.9
"""An object's velocity differs from the camera's by so many steps of the grid."""
SMOOTHING_PX, EVIDENCE_SMOOTHING_PX = 0.8, 2.0
EVIDENCE_FLOOR = 0.3
EVIDENCE_MIN, EVIDENCE_SHARE = 0.03, 0.12
"""Where the evidence is above this, and above this share of its peak, an object's events are."""
PART_SHARE = 0.15
"""Parts of an object have this share of the evidence of its largest part."""
EVIDENCE_PER_PX_MIN = 0.3
"""Least evidence per pixel of the box's outline."""
EVENTS_MIN = 25
TRIM = 0.02
NEARER_MAX, ASIDE_MAX = 2.0, 0.25
"""What goes where the picture goes, up to so many times as fast, and to the side by less than this share of what it is
faster by, may stand still, up to so many times as near as the rest: the camera slides past it."""


class CameraMotion:
    """Finds out whether the camera moves, and what moves otherwise.

    Args:
        events: where the events come from.

    Attributes:
        window_s: the time of events to look at next (s), about WINDOW_PX of motion.
        motion: the camera's; None if it stands still, or if that cannot be told.
    """

    def __init__(self, events: RecentEvents) -> None:
        self.window_s = WINDOW_MIN_S
        self.motion: Motion | None = None
        self._flow = CameraFlow(events)
        self._events = events
        self._width, self._height = events.width, events.height
        self._columns, self._rows = -(-events.width // TILE_PX), -(-events.height // TILE_PX)
        tiles = self._columns * self._rows
        rows, columns = np.divmod(np.arange(tiles), self._columns)
        self._x, self._y = (columns + 0.5) * TILE_PX - events.width / 2, (rows + 0.5) * TILE_PX - events.height / 2
        self._kept = np.zeros((tiles, TILE_EVENTS_MAX, 3), np.float32)
        self._seen = np.zeros(tiles, np.int32)
        self._scores = np.zeros((tiles, 2 * REACH + 1, 2 * REACH + 1), np.float32)
        self._step_px_s = 1.0

    def look(self, points: Float32Array, *, moves: bool) -> list[Sighting]:
        """Find the camera's motion, and what moves otherwise; nothing where the camera stands still.

        Args:
            points: the events of `window_s`, from `RecentEvents.points`.
            moves: whether the camera moved until now.
        """
        surrounded = SURROUNDED_ON if moves else SURROUNDED
        found = self._flow.look(surrounded)
        self.motion = self._flow.motion
        if self.motion is None:
            found = self._look_at_tiles(points, surrounded)
        return [sighting for sighting in found if not self._may_stand_nearer(sighting)]

    def _may_stand_nearer(self, sighting: Sighting) -> bool:
        """Whether something moves as what stands nearer does where the camera slides past."""
        assert self.motion is not None
        x, y = sighting.box.center
        camera = np.array(self.motion.at(np.array(x - self._width / 2), np.array(y - self._height / 2)))
        faster = np.array(sighting.velocity) - camera
        along, aside = float(faster @ camera), abs(float(faster[0] * camera[1] - faster[1] * camera[0]))
        return 0 < along < (NEARER_MAX - 1) * float(camera @ camera) and aside < ASIDE_MAX * along

    def _look_at_tiles(self, points: Float32Array, surrounded: float) -> list[Sighting]:
        """The same by trying out motions; the camera's tiles surround such a share of the sensor."""
        self._step_px_s = STEP_PX / self.window_s
        deal_to_tiles(points, len(points), TILE_PX, self._columns, self._kept, self._seen)
        score_tiles(self._kept, self._seen, TILE_EVENTS_MIN, TILE_PX, STEP_PX, self.window_s, self._scores)
        self._scores /= np.maximum(self._scores.max(axis=(1, 2), keepdims=True), 1e-6)
        tiles = np.flatnonzero(self._seen >= TILE_EVENTS_MIN)
        if len(tiles) < TILES_MIN:
            self.window_s = WINDOW_MIN_S
            return []
        motion = self._fit(tiles)
        speed = np.hypot(motion.x, motion.y) + np.hypot(motion.zoom, motion.roll) * self._width / 3
        self.window_s = float(np.clip(WINDOW_PX / max(speed, 1.0), WINDOW_MIN_S, WINDOW_MAX_S))
        shares = self._shares(tiles, motion)
        if not self._is_of_camera(tiles[shares >= FITS], len(tiles), surrounded):
            return []
        self.motion = motion
        outliers = np.zeros((self._rows, self._columns), np.uint8)
        outliers.flat[tiles[shares < STANDS_OUT]] = 1
        groups = sorted(_groups(outliers), key=len, reverse=True)[:GROUPS_MAX]
        return [sighting for group in groups if (sighting := self._sighting(points, group)) is not None]

    def _fit(self, tiles: npt.NDArray[np.int64]) -> Motion:
        """The motion that fits most tiles: the best shift, then zoom and roll from the tiles near it."""
        j, i = _peak(self._scores[tiles].sum(axis=0))
        motion = Motion((i - REACH) * self._step_px_s, (j - REACH) * self._step_px_s)
        x, y = self._x[tiles], self._y[tiles]
        for _ in range(FIT_ROUNDS):
            vx, vy, fits = self._near_peaks(tiles, *motion.at(x, y))
            if fits.sum() < TILES_MIN:
                break
            motion = _similarity(x[fits], y[fits], vx[fits], vy[fits], self._width)
        return motion

    def _near_peaks(
        self, tiles: npt.NDArray[np.int64], vx: Float64Array, vy: Float64Array
    ) -> tuple[Float64Array, Float64Array, npt.NDArray[np.bool_]]:
        """The middle of each tile's scores round a velocity, and whether it has any worth mentioning."""
        columns = np.clip(np.rint(vx / self._step_px_s).astype(int) + REACH, 1, 2 * REACH - 1)
        rows = np.clip(np.rint(vy / self._step_px_s).astype(int) + REACH, 1, 2 * REACH - 1)
        around = np.array([-1, 0, 1])
        near = self._scores[
            tiles[:, None, None], rows[:, None, None] + around[None, :, None], columns[:, None, None] + around
        ]
        weights = near**4
        totals = weights.sum(axis=(1, 2))
        dx = (weights * around).sum(axis=(1, 2)) / np.maximum(totals, 1e-6)
        dy = (weights * around[:, None]).sum(axis=(1, 2)) / np.maximum(totals, 1e-6)
        return (
            (columns - REACH + dx) * self._step_px_s,
            (rows - REACH + dy) * self._step_px_s,
            near.max(axis=(1, 2)) > FITS,
        )

    def _shares(self, tiles: npt.NDArray[np.int64], motion: Motion) -> Float64Array:
        """How much of its best velocity's score the motion's has, for each tile."""
        vx, vy = motion.at(self._x[tiles], self._y[tiles])
        columns = np.clip(vx / self._step_px_s + REACH, 0, 2 * REACH - 1e-6)
        rows = np.clip(vy / self._step_px_s + REACH, 0, 2 * REACH - 1e-6)
        i, j = columns.astype(int), rows.astype(int)
        right, below = columns - i, rows - j
        scores = self._scores
        return np.asarray(
            (1 - right) * (1 - below) * scores[tiles, j, i]
            + right * (1 - below) * scores[tiles, j, i + 1]
            + (1 - right) * below * scores[tiles, j + 1, i]
            + right * below * scores[tiles, j + 1, i + 1],
            np.float64,
        )

    def _is_of_camera(self, fitting: npt.NDArray[np.int64], tiles: int, surrounded: float) -> bool:
        """Whether these of so many tiles are all over the sensor: nothing but a camera moves that much."""
        if len(fitting) < max(TILES_MIN, CAMERA_SHARE * tiles):
            return False
        middles = np.stack([self._x[fitting], self._y[fitting]], axis=1)
        corners = np.concatenate([middles + np.array(corner) * TILE_PX / 2 for corner in CORNERS])
        return surrounded_share(corners, self._events) >= surrounded

    def _sighting(self, points: Float32Array, group: npt.NDArray[np.int64]) -> Sighting | None:
        """What moves in a group of tiles, if anything does."""
        assert self.motion is not None
        j, i = _peak(self._scores[group].sum(axis=0))
        own = ((i - REACH) * self._step_px_s, (j - REACH) * self._step_px_s)
        middle = self.motion.at(self._x[group].mean(), self._y[group].mean())
        camera = (float(middle[0]), float(middle[1]))
        if np.hypot(own[0] - camera[0], own[1] - camera[1]) < DIFFERENCE_STEPS * self._step_px_s:
            return None
        rows, columns = np.divmod(group, self._columns)
        left, top = (int(indices.min() - 1) * TILE_PX for indices in (columns, rows))
        right, bottom = (int(indices.max() + 2) * TILE_PX for indices in (columns, rows))
        inside = (points[:, X] >= left) & (points[:, X] < right) & (points[:, Y] >= top) & (points[:, Y] < bottom)
        local = points[inside]
        local[:, X] -= left
        local[:, Y] -= top
        return self._told_apart(local, (bottom - top, right - left), own, camera, (left, top))

    def _told_apart(
        self,
        points: Float32Array,
        shape: tuple[int, int],
        own: tuple[float, float],
        camera: tuple[float, float],
        corner: tuple[int, int],
    ) -> Sighting | None:
        """The events that move with a velocity of their own rather than with the camera (places from a corner)."""
        room = np.zeros(shape, np.float32)
        in_group = (np.abs(points[:, X] - shape[1] / 2) < shape[1] / 2 - TILE_PX) & (
            np.abs(points[:, Y] - shape[0] / 2) < shape[0] / 2 - TILE_PX
        )
        own = refined_velocity(points[in_group], *own, self._step_px_s, room)
        camera = refined_velocity(points[~in_group], *camera, self._step_px_s, room)
        evidence, places = room, np.zeros((len(points), 3), np.float32)
        pictures = []
        for velocity in (own, camera):
            picture = np.zeros(shape, np.float32)
            draw(points, *velocity, picture)
            pictures.append(np.asarray(cv2.GaussianBlur(picture, (3, 3), SMOOTHING_PX), np.float32))
        read_evidence(points, *own, pictures[0], *camera, pictures[1], EVIDENCE_FLOOR, evidence, places)
        smooth = cv2.GaussianBlur(evidence, (0, 0), EVIDENCE_SMOOTHING_PX)
        parts = (smooth > max(EVIDENCE_MIN, EVIDENCE_SHARE * float(smooth.max()))).astype(np.uint8)
        number, labels = cv2.connectedComponents(parts, connectivity=8)
        if number < 2:
            return None
        weights = np.bincount(labels.ravel(), smooth.ravel(), number)
        weights[0] = 0.0
        kept = weights >= PART_SHARE * weights.max()
        is_own = (places[:, 2] > 0) & kept[labels[places[:, 1].astype(int), places[:, 0].astype(int)]]
        if is_own.sum() < EVENTS_MIN:
            return None
        box = box_round(places[is_own, 0] + corner[0], places[is_own, 1] + corner[1], TRIM)
        if weights[kept].sum() < EVIDENCE_PER_PX_MIN * 2 * (box.w + box.h):
            return None
        return Sighting(box, (float(own[0]), float(own[1])), 0.5 * self._step_px_s)


def _similarity(x: Float64Array, y: Float64Array, vx: Float64Array, vy: Float64Array, width: int) -> Motion:
    """Least squares of shift, zoom and roll; the latter two are taken for small ones without evidence."""
    one, none = np.ones_like(x), np.zeros_like(x)
    of_x, of_y = np.stack([one, none, x, -y], axis=1), np.stack([none, one, y, x], axis=1)
    matrix, values = np.concatenate([of_x, of_y]), np.concatenate([vx, vy])
    normal = matrix.T @ matrix + np.diag([1e-6, 1e-6, *(2 * [ZOOM_PRIOR * (width / 4) ** 2])])
    return Motion(*(float(value) for value in np.linalg.solve(normal, matrix.T @ values)))


def _peak(scores: Float32Array) -> tuple[int, int]:
    row, column = np.unravel_index(int(scores.argmax()), scores.shape)
    return int(row), int(column)


def _groups(tiles: npt.NDArray[np.uint8]) -> Iterator[npt.NDArray[np.int64]]:
    """The tiles of each group of neighbours, by their numbers."""
    number, labels = cv2.connectedComponents(tiles, connectivity=8)
    for label in range(1, number):
        yield np.flatnonzero(labels == label)
