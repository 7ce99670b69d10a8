"""The object round a point, whether it moves of its own or with the picture: found by its contours."""

from __future__ import annotations

from collections import deque

import numpy as np

from etd_ros.boxes import Box, ious
from etd_ros.tracking.click_candidates import FEATURES, Candidates, candidates
from etd_ros.tracking.discovery import Discovery
from etd_ros.tracking.discovery_kernels import AGE, Float32Array, Float64Array, X, Y, draw
from etd_ros.tracking.local_motion import WINDOWS_S, motion_near

REACH_SHARE, REACH_MIN_PX, REACH_MAX_PX = 0.6, 8, 160
"""How far contours may be from the point: parts of the sensor's shorter side, and its limits (pixels)."""
LOOKS = 2
"""The newest looks of this number are gathered: more of them wait longer and are not better."""
MOTION_MAX_PX = 12
"""Events farther outside of the picture than this are not moved into it."""

WEIGHTS = {
    "elongation": -2.23,
    "off_middle": -0.51,
    "off_axis": -0.6,
    "ring": 0.35,
    "side_weakest": 0.54,
    "side_weak": 0.5,
    "side_strong": 0.45,
    "side_strongest": 0.25,
    "is_contour": -2.3,
    "contour_near": 3.97,
    "blobs_near": -0.26,
    "sighting_near": 2.94,
    "flock_near": 1.61,
}
"""What each feature adds to the logarithm of a candidate's chance: `etd_ros.evaluation.starting_choice` finds them."""
_WEIGHTS = np.array([WEIGHTS[name] for name in FEATURES])


class PointedObject:
    """Gathers what several looks say about the object round a point.

    A look moves the events on to now with the velocity that makes those near the point sharpest. Candidates are closed
    contours and blobs of events in that picture, and what was found by its motion; how likely each of them is the
    object is a softmax over weighted features. The answer is the box with the largest expected IoU.

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
        points = events.points(WINDOWS_S[0])
        followed = motion_near(points, self._x, self._y)
        if followed is None:
            return None
        velocity, window_s = followed
        self._move_on(velocity, events.stamp_ns)
        reach = int(np.clip(REACH_SHARE * min(events.width, events.height), REACH_MIN_PX, REACH_MAX_PX))
        left, top = self._x - reach, self._y - reach
        picture = _picture(points[points[:, AGE] < window_s], left, top, 2 * reach, velocity)
        corner = np.array([left, top, 0.0, 0.0])
        room = np.array([-left, -top, events.width - left, events.height - top])
        sightings, flock = (
            np.array([sighting.box for sighting in seen], np.float64).reshape(-1, 4) - corner
            for seen in (discovery.sightings, discovery.flock)
        )
        found = candidates(picture, room, (sightings, flock))
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


def _picture(points: Float32Array, left: float, top: float, side: int, velocity: tuple[float, float]) -> Float32Array:
    """Events moved on to now, as a square picture with this corner (pixels of the sensor)."""
    x, y = points[:, X] - np.float32(left), points[:, Y] - np.float32(top)
    is_near = (np.abs(x - side / 2) < side / 2 + MOTION_MAX_PX) & (np.abs(y - side / 2) < side / 2 + MOTION_MAX_PX)
    local = points[is_near]
    local[:, X], local[:, Y] = x[is_near], y[is_near]
    picture = np.zeros((side, side), np.float32)
    draw(local, *velocity, picture)
    return picture
