"""Boxes between key frames, and the key frames from which given boxes follow."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box, BoxArray
from etd_ros.evaluation.truth import TimedBox
from etd_ros.labelling.key_frames import KeyFrame

ROUNDING_PX = 0.0011
"""What writing to 1/1000 of a pixel can move a box between two others by, and a little more for the arithmetic."""
GAP_SPACINGS = 1.5
"""A stretch without labels that is longer than so many of their usual spacings is one where the target is not seen."""

StampArray = npt.NDArray[np.int64]
"""Times in ascending order (ns), int64, shape (n,)."""


def boxes_at(key_frames: Sequence[KeyFrame], stamps: StampArray) -> BoxArray:
    """Boxes at given times, float64 of shape (n, 4), NaN where there is no label.

    Between two key frames with boxes, position and size are linear in time. There is no label before the first, after
    the last, and on either side of a key frame without a box as far as the next one with.
    """
    boxes = np.full((len(stamps), 4), np.nan)
    for key in key_frames:
        if key.box is not None:
            boxes[stamps == key.stamp_ns] = key.box
    for before, after in itertools.pairwise(key_frames):
        if before.box is None or after.box is None:
            continue
        first, last = np.searchsorted(stamps, before.stamp_ns, "right"), np.searchsorted(stamps, after.stamp_ns)
        boxes[first:last] = _between(before.stamp_ns, before.box, after.stamp_ns, after.box, stamps[first:last])
    return boxes


def labels_from(key_frames: Sequence[KeyFrame], picture_stamps: StampArray, class_id: str = "") -> list[TimedBox]:
    """A label for each picture between key frames, and for each key frame with a box, in order of time; each says of
    the target that it is of this class."""
    own = np.array([key.stamp_ns for key in key_frames if key.box is not None], np.int64)
    stamps = np.union1d(picture_stamps, own)
    boxes = boxes_at(key_frames, stamps)
    labelled = ~np.isnan(boxes[:, 0])
    return [
        TimedBox(stamp_ns, Box(*box), class_id)
        for stamp_ns, box in zip(stamps[labelled].tolist(), boxes[labelled].tolist(), strict=True)
    ]


def key_frames_from(labels: Sequence[TimedBox], picture_stamps: StampArray) -> tuple[KeyFrame, ...]:
    """Few key frames from which given labels of one target, in order of time, follow to 1/1000 of a pixel.

    A stretch that holds a picture and no label, and is longer than 1.5 times the usual time between labels, becomes a
    key frame without a box at its first picture.
    """
    stamps = np.array([label.stamp_ns for label in labels], np.int64)
    spacings = np.diff(stamps)
    first_after = np.searchsorted(picture_stamps, stamps[:-1], "right")
    holds_picture = np.searchsorted(picture_stamps, stamps[1:]) > first_after
    is_gap = holds_picture & (spacings > GAP_SPACINGS * np.median(spacings)) if len(spacings) else holds_picture
    ends = [*np.flatnonzero(is_gap).tolist(), len(labels) - 1]
    key_frames: list[KeyFrame] = []
    start = 0
    for end in ends:
        key_frames += [KeyFrame(labels[i].stamp_ns, labels[i].box) for i in _corners(labels[start : end + 1], start)]
        if end < len(labels) - 1:
            key_frames.append(KeyFrame(int(picture_stamps[first_after[end]]), None))
        start = end + 1
    return tuple(key_frames)


def _between(
    start_ns: int, start: Sequence[float], end_ns: int, end: Sequence[float], stamps: StampArray
) -> npt.NDArray[np.float64]:
    share = (stamps - start_ns)[:, None] / (end_ns - start_ns)
    return np.asarray(np.asarray(start) + share * (np.asarray(end) - np.asarray(start)), np.float64)


def _corners(labels: Sequence[TimedBox], offset: int) -> list[int]:
    """Indices of the labels between which the others are linear, `offset` added: split where one is farthest from the
    line between the ends (Ramer, Douglas and Peucker), which in what was linear by parts is always a corner."""
    stamps = np.array([label.stamp_ns for label in labels], np.int64)
    boxes = np.array([label.box for label in labels], np.float64)
    corners = {0, len(labels) - 1}
    waiting = [(0, len(labels) - 1)]
    while waiting:
        first, last = waiting.pop()
        inner = slice(first + 1, last)
        if last - first < 2:
            continue
        line = _between(int(stamps[first]), boxes[first], int(stamps[last]), boxes[last], stamps[inner])
        distances = np.abs(boxes[inner] - line).max(axis=1)
        farthest = int(np.argmax(distances))
        if distances[farthest] > ROUNDING_PX:
            corner = first + 1 + farthest
            corners.add(corner)
            waiting += [(first, corner), (corner, last)]
    return [corner + offset for corner in sorted(corners)]
