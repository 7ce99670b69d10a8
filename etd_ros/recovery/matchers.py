"""Siamese networks behind one face: exemplars in, and how much every place of a window is like them out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from etd_ros.recovery import compact, siamrpn
from etd_ros.recovery.appearance import GreyImage

THREADS = 1
"""Of torch in this process: recovery runs beside nodes that must not wait for it."""


class Answers(NamedTuple):
    """What a network says about the places of a window.

    Attributes:
        scores: 0 to 1, of each template at each place, float32, shape (templates, rows, columns).
        boxes: centre x, y, width, height on the window (pixels), float32, shape (templates, 4, rows, columns).
    """

    scores: npt.NDArray[np.float32]
    boxes: npt.NDArray[np.float32]


class Matcher(Protocol):
    """A network for inference. Templates are what it makes of exemplars; targets and windows may share it.

    Attributes:
        exemplar_side: side of an exemplar's crop (pixels).
        margin: how far from a window's edge the first place is (pixels).
        window_pixels_max: of one search, for its time's sake.
    """

    exemplar_side: int
    margin: int
    window_pixels_max: int

    def template(self, exemplar: GreyImage, size: tuple[float, float]) -> Any:
        """What is remembered of a crop with the target of a size (w, h; pixels of the crop) in its middle."""
        ...

    def match(self, window: GreyImage, templates: Sequence[Any]) -> Answers:
        """Compare all places of a window, sides multiples of 8 pixels, with templates."""
        ...


class _CompactTemplate(NamedTuple):
    kernels: compact.Kernels
    size: torch.Tensor


class CompactMatcher:
    """The compact network."""

    exemplar_side = compact.EXEMPLAR_SIDE
    margin = int(compact.FIRST_CENTER)
    window_pixels_max = 272 * 272

    def __init__(self, network: compact.Compact) -> None:
        torch.set_num_threads(THREADS)
        self._network = fused(network)
        self._network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        # The first run sets the library up: not in the middle of a stream.
        blank = np.zeros((compact.INSTANCE_SIDE, compact.INSTANCE_SIDE), np.uint8)
        side = compact.EXEMPLAR_SIDE
        self.match(blank, [self.template(blank[:side, :side], (side / 2, side / 2))])

    def template(self, exemplar: GreyImage, size: tuple[float, float]) -> _CompactTemplate:
        with torch.inference_mode():
            sizes = torch.tensor([size], dtype=torch.float32)
            return _CompactTemplate(self._network.remember(_grey(exemplar), sizes), sizes)

    def match(self, window: GreyImage, templates: Sequence[_CompactTemplate]) -> Answers:
        with torch.inference_mode():
            features = self._network.features(_grey(window))
            responses = [self._network.match(template.kernels, features) for template in templates]
            boxes = [
                compact.boxes_of(response.changes, template.size)
                for response, template in zip(responses, templates, strict=True)
            ]
            scores = torch.cat([response.logits for response in responses]).sigmoid()
            return Answers(scores.numpy(), torch.cat(boxes).numpy())


class SiamRpnMatcher:
    """DaSiamRPN: at each place the best of its five anchors answers."""

    exemplar_side = siamrpn.EXEMPLAR_SIDE
    margin = 64
    window_pixels_max = 272 * 272

    def __init__(self, network: siamrpn.SiamRpn) -> None:
        torch.set_num_threads(THREADS)
        self._network = network

    def template(self, exemplar: GreyImage, size: tuple[float, float]) -> siamrpn.Kernels:  # noqa: ARG002
        with torch.inference_mode():
            return self._network.remember(siamrpn.as_bgr(exemplar))

    def match(self, window: GreyImage, templates: Sequence[siamrpn.Kernels]) -> Answers:
        with torch.inference_mode():
            features = self._network.window(siamrpn.as_bgr(window))
            answers = [self._best(*self._network.match(template, features), window.shape) for template in templates]
            scores, boxes = (torch.stack(parts).numpy() for parts in zip(*answers, strict=True))
            return Answers(scores, boxes)

    def _best(
        self, scores: torch.Tensor, changes: torch.Tensor, shape: tuple[int, ...]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        boxes = siamrpn.boxes_of(changes, (shape[1], shape[0]))
        best, index = scores.max(0)
        return best, boxes.gather(1, index.expand(4, 1, -1, -1))[:, 0]


def fused(network: compact.Compact) -> compact.Compact:
    """The network with its batch normalisations folded into the convolutions before them; a fifth less time."""
    for module in network.modules():
        if not isinstance(module, nn.Sequential):
            continue
        layers = list(module)
        for index in range(len(layers) - 1):
            convolution, normalisation = layers[index], layers[index + 1]
            if isinstance(convolution, nn.Conv2d) and isinstance(normalisation, nn.BatchNorm2d):
                module[index] = fuse_conv_bn_eval(convolution, normalisation)
                module[index + 1] = nn.Identity()
    return network


def _grey(pixels: GreyImage) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(pixels)).float()[None, None]
