"""The object round a point, whether it moves of its own or with the picture: found by its contours."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from etd_ros.boxes import Box, ious
from etd_ros.tracking.click_candidates import FEATURES, Candidates, candidates
from etd_ros.tracking.discovery import Discovery
from etd_ros.tracking.discovery_kernels import AGE, Float32Array, Float64Array, X, Y, draw
from etd_ros.tracking.local_motion import SPAN_S, followed_s, velocity_near
from etd_ros.tracking.moving_alike import are_own

REACH_SHARE, REACH_MIN_PX, REACH_MAX_PX = 0.6, 8, 160
"""How far contours may be from the point: parts of the sensor's shorter side, and its limits (pixels)."""
LOOKS = 2
"""The newest looks of this number are gathered: more of them wait longer and are not better."""
MOTION_MAX_PX = 12
"""Events farther outside of the picture than this are not moved into it."""
TELLING_PX = 3.0
"""What moves by less in the time of the events cannot be told from what stands nearer or farther."""

WEIGHTS = {
    "elongation": -2.36,
    "off_middle": -0.71,
    "off_axis": -1.02,
    "ring": 0.34,
    "side_weakest": 0.62,
    "side_weak": 0.41,
    "side_strong": 0.11,
    "side_strongest": -0.03,
    "is_contour": -1.45,
    "contour_near": 2.72,
    "blobs_near": -0.25,
    "own_ring": -0.52,
    "own_side_weakest": 0.02,
    "own_side_weak": 0.13,
    "own_side_strong": 0.19,
    "own_side_strongest": 0.35,
    "own_is_contour": -1.59,
    "own_contour_near": 0.69,
    "own_blobs_near": 0.07,
    "sighting_near": 2.4,
    "flock_near": 2.28,
}
"""What each feature adds to the logarithm of a candidate's chance: `etd_ros.evaluation.starting_choice` finds them."""
_WEIGHTS = np.array([WEIGHTS[name] for name in FEATURES])


class PointedObject:
    """Gathers what several looks say about the object round a point.

    A look moves the events on to now with the velocity with which most edges near the point go. Candidates are closed
    contours and blobs of events in two pictures, of all events and of those that move so rather than slower or faster,
    and what was found by its motion; how likely each of them is the object is a softmax over weighted features. The
    answer is the box with the largest expected IoU.

    Args:
        x, y: the point (pixels).
        stamp_ns: when the object was there (ns).
    """

    def __init__(self, x: float, y: float, stamp_ns: int) -> None:
        self._x, self._y, self._stamp_ns = x, y, stamp_ns
        self._boxes: deque[Float64Array] = deque(maxlen=LOOKS)
        self._chances: deque[Float64Array] = deque(maxlen=LOOKS)

    @property
    def looks(self) -> int:
        """How many of the newest looks have found anything, LOOKS at most."""
        return len(self._boxes)

    def look(self, discovery: Discovery) -> None:
        """Look once more, where a discovery has just looked."""
        found = self.candidates(discovery)
        if found is None or len(found.boxes) == 0:
            return
        scores = found.features @ _WEIGHTS
        chances = np.exp(scores - scores.max())
        self._boxes.append(found.boxes)
        self._chances.append(chances / chances.sum())

    def candidates(self, discovery: Discovery) -> Candidates | None:
        """The candidates of one look, in pixels of the sensor; None where there are hardly any events."""
        events = discovery.events
        points = events.points(SPAN_S)
        velocity = velocity_near(events, self._x, self._y)
        if velocity is None:
            return None
        self._move_on(velocity, events.stamp_ns)
        reach = int(np.clip(REACH_SHARE * min(events.width, events.height), REACH_MIN_PX, REACH_MAX_PX))
        left, top = self._x - reach, self._y - reach
        window_s = followed_s(velocity)
        everything, own = _pictures(points[points[:, AGE] < window_s], left, top, 2 * reach, velocity, window_s)
        corner = np.array([left, top, 0.0, 0.0])
        room = np.array([-left, -top, events.width - left, events.height - top])
        sightings, flock = (
            np.array([sighting.box for sighting in seen], np.float64).reshape(-1, 4) - corner
            for seen in (discovery.sightings, discovery.flock)
        )
        found = candidates(everything, own, room, (sightings, flock))
        return Candidates(found.boxes + corner, found.features)

    def best(self) -> tuple[Box, float]:
        """The box (pixels) with the largest expected IoU, and that; after at least one look that found anything."""
        boxes = np.concatenate(self._boxes)
        chances = np.concatenate(self._chances) / self.looks
        expected = ious(boxes, boxes) @ chances
        best = int(expected.argmax())
        return Box(*(float(value) for value in boxes[best])), float(expected[best])

    def _move_on(self, velocity: tuple[float, float], stamp_ns: int) -> None:
        """Move the point, and what was found, on to now."""
        shift = np.array(velocity) * ((stamp_ns - self._stamp_ns) * 1e-9)
        self._stamp_ns = stamp_ns
        self._x, self._y = self._x + float(shift[0]), self._y + float(shift[1])
        for boxes in self._boxes:
            boxes[:, :2] += shift


def _pictures(
    points: Float32Array, left: float, top: float, side: int, velocity: tuple[float, float], window_s: float
) -> tuple[Float32Array, Float32Array]:
    """Events moved on to now, as a square picture with this corner (pixels of the sensor): all of them, and those that
    move like the object, which cannot be told of what hardly moves in the time of the events."""
    x, y = points[:, X] - np.float32(left), points[:, Y] - np.float32(top)
    is_near = (np.abs(x - side / 2) < side / 2 + MOTION_MAX_PX) & (np.abs(y - side / 2) < side / 2 + MOTION_MAX_PX)
    local = points[is_near]
    local[:, X], local[:, Y] = x[is_near], y[is_near]
    everything, own = np.zeros((2, side, side), np.float32)
    draw(local, *velocity, everything)
    if math.hypot(*velocity) * window_s < TELLING_PX:
        return everything, everything
    draw(np.ascontiguousarray(local[are_own(local, velocity, side)]), *velocity, own)
    return everything, own
