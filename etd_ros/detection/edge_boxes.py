"""EdgeBoxes proposals (Zitnick and Dollar 2014) in the search region round a target's last box."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.boxes import Box, BoxArray
from etd_ros.detection.edges import edges_of
from etd_ros.detection.errors import DetectionError
from etd_ros.parameters import Parameters, parameter

PADDING = 3
"""Empty pixels round the region: EdgeBoxes ignores contours within 2 pixels of its map's border."""
ASPECT_RATIO_LIMIT = 20.0
"""With it, and the smallest min_box_area, EdgeBoxes' windows are at least a pixel wide."""


@dataclass(frozen=True, slots=True)
class EdgeBoxesConfig(Parameters):
    """Parameters of the proposals; the defaults are the paper's, and OpenCV's where the paper says nothing."""

    search_scale: float = parameter(
        1.5,
        "Size of the search region over the last box's (tau). Larger follows faster motion and costs its square.",
        low=1.0,
        high=10.0,
    )
    max_boxes: int = parameter(1000, "Proposals kept at most, best first.", low=1, high=10_000)
    min_box_area: float = parameter(
        100.0, "Area of the smallest window (pixels^2). Smaller targets need less.", low=25.0, high=1e6
    )
    max_aspect_ratio: float = parameter(
        3.0,
        "Longest window's aspect ratio; raised for a target that is itself longer.",
        low=1.0,
        high=ASPECT_RATIO_LIMIT,
    )
    window_step: float = parameter(
        0.65, "IoU of neighbouring windows (alpha). Higher places boxes better and is slower.", low=0.4, high=0.9
    )
    nms_overlap: float = parameter(
        0.75, "IoU from which on the weaker of two proposals is dropped (beta).", low=0.1, high=1.0
    )
    thin_edges: bool = parameter(True, "Thin contours to their ridge first; thick ones inflate boxes and cost time.")
    refit_boxes: bool = parameter(
        True, "Shrink each proposal to the event pixels in it; EdgeBoxes is a few pixels loose."
    )
    max_region_side: int = parameter(
        400,
        "Search regions with a longer side (pixels) are halved until they fit, which bounds the time a target takes.",
        low=50,
        high=4000,
    )


@dataclass(frozen=True, slots=True)
class Proposals:
    """Boxes that may hold an object.

    Attributes:
        boxes: float64, shape (n, 4), sensor pixels.
        scores: EdgeBoxes' objectness, float64, shape (n,), not increasing.
    """

    boxes: BoxArray
    scores: npt.NDArray[np.float64]

    @classmethod
    def none(cls) -> Proposals:
        """No proposals."""
        return cls(np.empty((0, 4)), np.empty(0))

    def __len__(self) -> int:
        return len(self.scores)


@dataclass(frozen=True, slots=True)
class _Region:
    """Whole pixels left <= x < right, top <= y < bottom of the sensor."""

    left: int
    top: int
    right: int
    bottom: int


class EdgeBoxes:
    """Proposals from the contours of event frames. Holds no state between calls: one serves any number of targets.

    Raises:
        DetectionError: this OpenCV build has no EdgeBoxes.
    """

    def __init__(self, config: EdgeBoxesConfig | None = None) -> None:
        if not hasattr(cv2, "ximgproc") or not hasattr(cv2.ximgproc, "createEdgeBoxes"):
            msg = (
                f"OpenCV {cv2.__version__} lacks cv2.ximgproc, which holds EdgeBoxes: "
                "install the contrib build (pip: opencv-contrib-python-headless, apt: python3-opencv)"
            )
            raise DetectionError(msg)
        self.config = config or EdgeBoxesConfig()

    def propose(self, frame_data: npt.NDArray[np.uint8], last_box: Box, *, admissibility_min: float = 0.0) -> Proposals:
        """Object proposals in the region centred on the last box, search_scale times its size (paper Sec. 3.3).

        Args:
            frame_data: frame, uint8, shape (height, width, 2), 0 no event.
            last_box: O_{i-1} (pixels).
            admissibility_min: lambda, if proposals of a lower `admissibility` are of no use: windows much smaller than
                any that passes are then not looked at, a third to a fifth of the time. It does not filter. What passes
                stays the same but for rare boxes that a smaller one would have suppressed.

        Returns:
            Proposals in sensor pixels; none where the region lies off the sensor or holds no event.

        Raises:
            DetectionError: the frame has another shape or dtype.
        """
        if frame_data.ndim != 3 or frame_data.shape[2] != 2 or frame_data.dtype != np.uint8:
            msg = f"a frame must be uint8 (height, width, 2), not {frame_data.dtype} {frame_data.shape}"
            raise DetectionError(msg)
        height, width = frame_data.shape[:2]
        region = _search_region(last_box, self.config.search_scale, width, height)
        if region is None:
            return Proposals.none()
        both = frame_data[region.top : region.bottom, region.left : region.right]
        events = np.maximum(both[..., 0], both[..., 1])
        if not events.any():
            return Proposals.none()
        shrink = _halvings(max(events.shape), self.config.max_region_side)
        proposals = self._propose_in(
            _shrunk(events, shrink), last_box.w / shrink, last_box.h / shrink, admissibility_min
        )
        boxes = proposals.boxes * shrink + (region.left, region.top, 0, 0)
        return Proposals(boxes, proposals.scores)

    def _propose_in(
        self, events: npt.NDArray[np.uint8], last_w: float, last_h: float, admissibility_min: float
    ) -> Proposals:
        """Proposals in a region's own pixels."""
        config = self.config
        admissible_area = admissibility_min * last_w * last_h
        if admissible_area > events.size:
            return Proposals.none()
        padded = np.pad(events, PADDING)
        edges, orientation = edges_of(padded, thin=config.thin_edges)
        # A new one a call: a reused one keeps the memory of every call, a new one costs microseconds.
        detector = cv2.ximgproc.createEdgeBoxes(
            alpha=config.window_step,
            beta=config.nms_overlap,
            maxBoxes=config.max_boxes,
            minBoxArea=_smallest_useful_area(config, admissible_area),
            maxAspectRatio=min(max(config.max_aspect_ratio, last_w / last_h, last_h / last_w), ASPECT_RATIO_LIMIT),
        )
        found, scores = detector.getBoundingBoxes(edges, orientation)
        if len(found) == 0:
            return Proposals.none()
        boxes = np.asarray(found, np.int64) - (PADDING, PADDING, 0, 0)
        if config.refit_boxes:
            boxes = refit(boxes, events)
        return Proposals(boxes.astype(np.float64), np.asarray(scores, np.float64).reshape(-1))


def _search_region(last_box: Box, scale: float, width: int, height: int) -> _Region | None:
    """The whole pixels of the sensor that the search region touches; None if fewer than 2 x 2."""
    wanted = last_box.scaled(scale)
    left, top = math.floor(_clamped(wanted.x, width)), math.floor(_clamped(wanted.y, height))
    right, bottom = math.ceil(_clamped(wanted.x + wanted.w, width)), math.ceil(_clamped(wanted.y + wanted.h, height))
    if right - left < 2 or bottom - top < 2:
        return None
    return _Region(left, top, right, bottom)


def _clamped(value: float, limit: int) -> float:
    return min(max(value, 0.0), limit)


def _smallest_useful_area(config: EdgeBoxesConfig, admissible_area: float) -> float:
    """The last step of EdgeBoxes' ladder of window areas at or below the smallest admissible one.

    Window areas are min_box_area / alpha^k. Starting on a later step of the same ladder leaves the larger windows
    exactly where they were; with any other start they would all move.
    """
    steps = math.log(max(admissible_area, config.min_box_area) / config.min_box_area) / -math.log(config.window_step)
    return float(config.min_box_area / config.window_step ** math.floor(steps))


def _halvings(side: int, max_side: int) -> int:
    """The smallest power of two that brings `side` to `max_side` or below."""
    return 1 << max(0, math.ceil(math.log2(side / max_side)))


def _shrunk(events: npt.NDArray[np.uint8], factor: int) -> npt.NDArray[np.uint8]:
    """Maximum over blocks of factor x factor pixels, which keeps contours closed; edges padded with 0."""
    if factor == 1:
        return events
    height, width = (-(-side // factor) * factor for side in events.shape)
    padded = np.zeros((height, width), np.uint8)
    padded[: events.shape[0], : events.shape[1]] = events
    return np.asarray(padded.reshape(height // factor, factor, width // factor, factor).max(axis=(1, 3)), np.uint8)


@njit(cache=True, nogil=True)
def refit(boxes: npt.NDArray[np.int64], events: npt.NDArray[np.uint8]) -> npt.NDArray[np.int64]:
    """Each box shrunk to the bounding box of the event pixels in it; a box without any stays as it is.

    Args:
        boxes: x, y, w, h, int64, shape (n, 4); may reach over the region.
        events: the region, uint8, shape (h, w), 0 no event.

    Returns:
        A new array, int64, shape (n, 4).
    """
    height, width = events.shape
    fitted = boxes.copy()
    for i in range(len(boxes)):
        left, right = max(boxes[i, 0], 0), min(boxes[i, 0] + boxes[i, 2], width)
        top, bottom = max(boxes[i, 1], 0), min(boxes[i, 1] + boxes[i, 3], height)
        first_x, last_x, first_y, last_y = width, -1, height, -1
        for y in range(top, bottom):
            for x in range(left, right):
                if events[y, x]:
                    first_x, last_x = min(first_x, x), max(last_x, x)
                    first_y, last_y = min(first_y, y), max(last_y, y)
        if first_x <= last_x:
            fitted[i, 0], fitted[i, 2] = first_x, last_x - first_x + 1
            fitted[i, 1], fitted[i, 3] = first_y, last_y - first_y + 1
    return fitted
