"""SiamFC as a tracker: an exemplar of the first picture, looked for at three scales round the last place
(Bertinetto et al. 2016, Sec. 3.1 and 4.1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.recovery.crops import Picture, cut, exemplar_extent


class SiamFcGeometry(NamedTuple):
    """Of a SiamFC network.

    Attributes:
        exemplar_side, instance_side: sides of its crops (pixels).
        stride: distance of the places that it answers for (pixels of a crop).
        response_side: how many of them there are down and across.
    """

    exemplar_side: int
    instance_side: int
    stride: int
    response_side: int = 17


PUBLISHED_GEOMETRY, SMALL_GEOMETRY = SiamFcGeometry(127, 255, 8), SiamFcGeometry(63, 127, 4)

SCALE_STEP, SCALE_PENALTY, SCALE_RATE = 1.0375, 0.9745, 0.59
"""Of the public three-scale tracker: from one scale to the next, what a change of scale costs, and how much of it is
taken."""
WINDOW_INFLUENCE = 0.176
UPSAMPLING = 16
SIZE_RATIO_MAX = 5.0
"""How far a target may grow or shrink in all, as in the authors' tracker."""

Responses = npt.NDArray[np.float32]


class SiamFcNetwork(Protocol):
    """A SiamFC for inference. Templates are what it makes of exemplars; targets and windows may share it."""

    geometry: SiamFcGeometry

    def template(self, exemplar: Picture) -> Any:
        """What is remembered of a crop with the target in its middle."""
        ...

    def responses(self, windows: Sequence[Picture], template: Any) -> Responses:
        """Logits of the target's centre being at the places of windows, shape (n, response_side, response_side)."""
        ...


class SiamFcTracker:
    """Follows one target from picture to picture. It never says that it has lost it.

    Args:
        network: which other targets may share.
    """

    def __init__(self, network: SiamFcNetwork) -> None:
        self._network = network
        side = network.geometry.response_side * UPSAMPLING
        hanning = np.outer(np.hanning(side), np.hanning(side))
        self._hanning = hanning / hanning.sum()
        self._template: Any = None
        self._center = (0.0, 0.0)
        self._size = (0.0, 0.0)
        self._growth = 1.0

    def start(self, picture: Picture, box: Box) -> None:
        """The target is at `box` (pixels); `picture` is uint8, grey or BGR."""
        self._center, self._size, self._growth = box.center, (box.w, box.h), 1.0
        side = self._network.geometry.exemplar_side
        exemplar = cut(picture, box.center, side / exemplar_extent(box.w, box.h), (side, side))
        self._template = self._network.template(exemplar.pixels)

    def update(self, picture: Picture) -> tuple[Box, float]:
        """The target's box in the next picture, and how sure the network is of its place, 0 to 1."""
        geometry = self._network.geometry
        scale = geometry.exemplar_side / (exemplar_extent(*self._size) * self._growth)
        factors = (1 / SCALE_STEP, 1.0, SCALE_STEP)
        window_size = (geometry.instance_side, geometry.instance_side)
        windows = [cut(picture, self._center, scale / factor, window_size).pixels for factor in factors]
        responses = self._network.responses(windows, self._template)
        chosen, offset_x, offset_y = self._peak(responses)
        strides = geometry.stride * factors[chosen] / scale
        self._center = self._center[0] + strides * offset_x, self._center[1] + strides * offset_y
        growth = self._growth * (1 + SCALE_RATE * (factors[chosen] - 1))
        self._growth = min(max(growth, 1 / SIZE_RATIO_MAX), SIZE_RATIO_MAX)
        w, h = (self._growth * side for side in self._size)
        box = Box(self._center[0] - w / 2, self._center[1] - h / 2, w, h)
        return box, _sigmoid(float(responses[chosen].max()))

    def _peak(self, responses: Responses) -> tuple[int, float, float]:
        """The likeliest scale, and how far the likeliest place there is from the window's middle (strides)."""
        side = len(self._hanning)
        upsampled = [cv2.resize(response, (side, side), interpolation=cv2.INTER_CUBIC) for response in responses]
        peaks = [float(response.max()) for response in upsampled]
        chosen = int(np.argmax([peaks[0] * SCALE_PENALTY, peaks[1], peaks[2] * SCALE_PENALTY]))
        response = upsampled[chosen] - upsampled[chosen].min()
        # A response that is the same everywhere says nothing: the window alone then keeps the target where it was.
        response = response / max(float(response.sum()), np.finfo(np.float32).tiny)
        response = (1 - WINDOW_INFLUENCE) * response + WINDOW_INFLUENCE * self._hanning
        row, column = np.unravel_index(int(np.argmax(response)), response.shape)
        middle = (side - 1) / 2
        return chosen, (float(column) - middle) / UPSAMPLING, (float(row) - middle) / UPSAMPLING


def _sigmoid(logit: float) -> float:
    return float(1 / (1 + np.exp(-np.clip(logit, -60, 60))))
