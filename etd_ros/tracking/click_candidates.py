"""Boxes that may be of the object round a point, and what tells how likely each of them is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import ious
from etd_ros.tracking.contour_paths import contour_paths
from etd_ros.tracking.discovery_kernels import Float32Array, Float64Array

BLOB_SIZES_PX, BLOB_SHARES = (1.5, 3.0, 5.0), (0.1, 0.2, 0.3, 0.45, 0.6)
"""Smoothing (pixels), and levels in parts of the most events near the point, at which events are one blob."""
BLOB_REACH_PX = 12
TRIM = 0.01
SIDE_MIN_PX = 6.0
"""Boxes with shorter sides are none."""
EVENTS_A_PIXEL_MAX = 2.0
EVENTS_SMOOTHING_PX = 0.8
FEW = 0.02
"""Added to densities (events a pixel) before their logarithms are taken."""
MARGIN_PX, MARGIN_SHARE = 2.0, 0.06
"""Width of the strips along a box: pixels, and parts of its shorter side."""
RING = 0.5, 1.5
"""The ring round a box, in margins beyond it."""
STRIP = (0.2, 0.8)
"""Which part of a side they lie along: a round object does not reach the corners."""
ALIKE_IOU = 0.5
_OF_PICTURE = (
    "ring",
    "side_weakest",
    "side_weak",
    "side_strong",
    "side_strongest",
    "is_contour",
    "contour_near",
    "blobs_near",
)
FEATURES = (
    "elongation",
    "off_middle",
    "off_axis",
    *_OF_PICTURE,
    *(f"own_{name}" for name in _OF_PICTURE),
    "sighting_near",
    "flock_near",
)
"""Columns of `Candidates.features`: those in the picture of the object's own events have their names from `own`."""


@dataclass(frozen=True, slots=True)
class Candidates:
    """Boxes that may be of the object.

    Attributes:
        boxes: left, top, width, height (pixels of the picture), float64, shape (n, 4).
        features: what tells how good each is, float64, shape (n, len(FEATURES)).
    """

    boxes: Float64Array
    features: Float64Array


def candidates(
    everything: Float32Array, own: Float32Array, room: Float64Array, seen: tuple[Float64Array, Float64Array]
) -> Candidates:
    """The boxes of closed contours round the middle of two pictures, and of blobs of events there.

    Args:
        everything: events a pixel, moved on to now, float32, square, of an even side.
        own: the same of those that move like the object.
        room: left, top, right, bottom of the sensor (pixels of the pictures), float64, shape (4,).
        seen: boxes (pixels of the pictures) of what was found by its motion, and of what moves with the picture,
            float64, shape (n, 4) each.
    """
    drawn = _Drawn(everything, room), _Drawn(own, room)
    boxes = np.concatenate(
        [*(of_picture.boxes for of_picture in drawn), *(_large(_within(each, room)) for each in seen)]
    )
    features = (
        *_shape_features(boxes, everything.shape[0] / 2),
        *drawn[0].features(boxes, 0),
        *drawn[1].features(boxes, len(drawn[0].boxes)),
        *(ious(boxes, others).max(axis=1, initial=0.0) for others in seen),
    )
    return Candidates(boxes, np.stack(features, axis=1).astype(np.float64))


class _Drawn:
    """A picture of events, and the boxes of contours and blobs in it.

    Args:
        picture: events a pixel, moved on to now, float32, square, of an even side.
        room: left, top, right, bottom of the sensor (pixels of the picture), float64, shape (4,).

    Attributes:
        boxes: what lies on the sensor of them, if it is large enough, float64, shape (n, 4).
    """

    def __init__(self, picture: Float32Array, room: Float64Array) -> None:
        self._picture = picture
        contours = contour_paths(picture)
        paths, blobs = _within(contours.boxes, room), _within(_blobs(picture), room)
        self._support = contours.support[_are_large(paths)]
        self.boxes = np.concatenate([_large(paths), _large(blobs)])

    def features(self, boxes: Float64Array, first: int) -> tuple[Float64Array, ...]:
        """What the picture says of boxes, one for each of _OF_PICTURE.

        Args:
            boxes: float64, shape (n, 4).
            first: where its own begin among them.
        """
        paths = len(self._support)
        is_contour = np.zeros(len(boxes))
        is_contour[first : first + paths] = self._support > 0
        overlaps = ious(boxes, self.boxes)
        return (
            *_density_features(boxes, self._picture),
            is_contour,
            (overlaps[:, :paths] * self._support).max(axis=1, initial=0.0),
            np.maximum(overlaps[:, paths:] - ALIKE_IOU, 0.0).sum(axis=1),
        )


def _blobs(picture: Float32Array) -> Float64Array:
    """The blobs of events at, or next to, the middle: where events are dense enough, at several sizes and levels."""
    middle = picture.shape[0] // 2
    boxes = []
    for size_px in BLOB_SIZES_PX:
        smooth = cv2.GaussianBlur(picture, (0, 0), size_px)
        first, last = max(0, middle - BLOB_REACH_PX), middle + BLOB_REACH_PX
        near = smooth[first:last, first:last]
        row, column = np.unravel_index(int(near.argmax()), near.shape)
        if near[row, column] <= 0:
            continue
        for share in BLOB_SHARES:
            is_dense = (smooth > share * near[row, column]).astype(np.uint8)
            seed = (first + int(column), first + int(row))
            _, _, _, (left, top, width, height) = cv2.floodFill(is_dense, None, seed, 2)
            part = picture[top : top + height, left : left + width]
            columns, rows = _trimmed(part.sum(axis=0)), _trimmed(part.sum(axis=1))
            boxes.append((left + columns[0], top + rows[0], columns[1] - columns[0], rows[1] - rows[0]))
    return np.array(boxes, np.float64).reshape(-1, 4)


def _trimmed(counts: Float32Array) -> tuple[float, float]:
    """First and last (exclusive) of the counts but for a share of their sum at both ends."""
    sums = counts.cumsum()
    first, last = np.searchsorted(sums, (TRIM * sums[-1], (1 - TRIM) * sums[-1]))
    return float(first), float(min(last + 1, len(counts)))


def _within(boxes: Float64Array, room: Float64Array) -> Float64Array:
    """The parts of the boxes that lie on the sensor."""
    corners = np.clip(
        np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1), room[[0, 1, 0, 1]], room[[2, 3, 2, 3]]
    )
    return np.concatenate([corners[:, :2], corners[:, 2:] - corners[:, :2]], axis=1)


def _are_large(boxes: Float64Array) -> npt.NDArray[np.bool_]:
    return np.asarray(boxes[:, 2:].min(axis=1) >= SIDE_MIN_PX, np.bool_)


def _large(boxes: Float64Array) -> Float64Array:
    """Those of the boxes that are large enough."""
    return boxes[_are_large(boxes)]


def _shape_features(boxes: Float64Array, middle: float) -> tuple[Float64Array, ...]:
    """Elongation, and how far the point is off the middle, in parts of the sides: along both, and the larger one."""
    x, y, w, h = boxes.T
    off_x, off_y = np.abs(x + w / 2 - middle) / w, np.abs(y + h / 2 - middle) / h
    return np.abs(np.log(w / h)), np.hypot(off_x, off_y), np.maximum(off_x, off_y)


def _density_features(boxes: Float64Array, picture: Float32Array) -> tuple[Float64Array, ...]:
    """Logarithms: how dense events are in the ring round the boxes, and how much denser they are along each side than
    beyond it, from the weakest side to the strongest."""
    events = np.minimum(cv2.GaussianBlur(picture, (0, 0), EVENTS_SMOOTHING_PX), EVENTS_A_PIXEL_MAX)
    sums = _Sums(events)
    x, y, w, h = boxes.T
    right, bottom = x + w, y + h
    margin = MARGIN_PX + MARGIN_SHARE * np.minimum(w, h)
    near, far = (
        sums.total(x - reach, y - reach, right + reach, bottom + reach)
        for reach in (RING[0] * margin, RING[1] * margin)
    )
    ring = np.log((far[0] - near[0]) / np.maximum(far[1] - near[1], 1) + FEW) - np.log(events.mean() + FEW)
    upper, lower = y + STRIP[0] * h, y + STRIP[1] * h
    left_part, right_part = x + STRIP[0] * w, x + STRIP[1] * w
    sides = np.sort(
        [
            sums.log_ratio((x - 1, upper, x + margin, lower), (x - 1 - margin, upper, x - 1, lower)),
            sums.log_ratio((right - margin, upper, right + 1, lower), (right + 1, upper, right + 1 + margin, lower)),
            sums.log_ratio((left_part, y - 1, right_part, y + margin), (left_part, y - 1 - margin, right_part, y - 1)),
            sums.log_ratio(
                (left_part, bottom - margin, right_part, bottom + 1),
                (left_part, bottom + 1, right_part, bottom + 1 + margin),
            ),
        ],
        axis=0,
    )
    return ring, *sides


class _Sums:
    """Sums of events in rectangles."""

    def __init__(self, events: Float32Array) -> None:
        self._sums = cv2.integral(events)

    def total(
        self, left: Float64Array, top: Float64Array, right: Float64Array, bottom: Float64Array
    ) -> tuple[Float64Array, Float64Array]:
        """The events in rectangles, as far as they lie in the picture, and how many pixels that is (1 or more)."""
        side = self._sums.shape[0] - 1
        x0, y0, x1, y1 = (np.clip(np.rint(edge), 0, side).astype(np.int64) for edge in (left, top, right, bottom))
        sums = self._sums[y1, x1] - self._sums[y0, x1] - self._sums[y1, x0] + self._sums[y0, x0]
        return np.asarray(sums, np.float64), np.maximum((x1 - x0) * (y1 - y0), 1).astype(np.float64)

    def log_ratio(self, first: tuple[Float64Array, ...], second: tuple[Float64Array, ...]) -> Float64Array:
        """How much denser events are in the first rectangles than in the second ones."""
        densities = [np.divide(*self.total(*rectangle)) for rectangle in (first, second)]
        return np.asarray(np.log((densities[0] + FEW) / (densities[1] + FEW)), np.float64)
