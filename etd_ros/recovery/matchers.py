"""Siamese networks as `Matcher`s: exemplars in, and how much every place of a window is like them out."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Thread
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
import torch
from torch import nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from etd_ros.recovery import compact, siamrpn
from etd_ros.recovery.crops import Picture
from etd_ros.recovery.matching import COMPACT_GEOMETRY, SIAMRPN_GEOMETRY, Answers
from etd_ros.recovery.siamfc import SiamFc
from etd_ros.recovery.siamfc_tracking import Responses

Network = TypeVar("Network", bound=nn.Module)

THREADS = 1
"""Of torch for recovery: it runs beside nodes that must not wait for it."""


def limit_threads() -> None:
    """Have torch use one thread for what the calling thread computes, and as many as before for everybody else.

    torch keeps the number for each thread, and the last one set for threads to come.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(THREADS)
    others = Thread(target=torch.set_num_threads, args=(before,))
    others.start()
    others.join()


class _CompactTemplate(NamedTuple):
    kernels: compact.Kernels
    size: torch.Tensor


class CompactMatcher:
    """The compact network."""

    geometry = COMPACT_GEOMETRY

    def __init__(self, network: compact.Compact) -> None:
        self._network = fused(network)
        self._network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        # The first run sets the library up: not in the middle of a stream.
        blank = np.zeros((compact.INSTANCE_SIDE, compact.INSTANCE_SIDE), np.uint8)
        side = compact.EXEMPLAR_SIDE
        self.match(blank, [self.template(blank[:side, :side], (side / 2, side / 2))])

    def template(self, exemplar: Picture, size: tuple[float, float]) -> _CompactTemplate:
        with torch.inference_mode():
            sizes = torch.tensor([size], dtype=torch.float32)
            return _CompactTemplate(self._network.remember(_grey(exemplar), sizes), sizes)

    def match(
        self,
        window: Picture,
        templates: Sequence[_CompactTemplate],
        distractors: Sequence[_CompactTemplate] = (),
    ) -> Answers:
        with torch.inference_mode():
            windows = self._network.look(_grey(window))
            responses = [self._network.match(template.kernels, windows) for template in templates]
            others = [self._network.likeness(distractor.kernels, windows) for distractor in distractors]
            boxes = [
                compact.boxes_of(response.changes, template.size)
                for response, template in zip(responses, templates, strict=True)
            ]
            scores = torch.cat([*(response.logits for response in responses), *others]).sigmoid()
            return Answers(scores.numpy(), torch.cat(boxes).numpy())


class SiamRpnMatcher:
    """DaSiamRPN: at each place the best of its five anchors answers.

    Args:
        network: the published one.
        every_anchor: whether all five answer, each for itself.
    """

    geometry = SIAMRPN_GEOMETRY

    def __init__(self, network: siamrpn.SiamRpn, *, every_anchor: bool = False) -> None:
        self._network = network
        self._every_anchor = every_anchor

    @property
    def is_big(self) -> bool:
        """Whether it is SiamRPNBIG."""
        return self._network.conv_r2.out_channels > min(siamrpn.SIZES)

    def template(self, exemplar: Picture, size: tuple[float, float]) -> siamrpn.Kernels:  # noqa: ARG002
        with torch.inference_mode():
            return self._network.remember(siamrpn.as_bgr(exemplar))

    def match(
        self, window: Picture, templates: Sequence[siamrpn.Kernels], distractors: Sequence[siamrpn.Kernels] = ()
    ) -> Answers:
        with torch.inference_mode():
            features = self._network.window(siamrpn.as_bgr(window))
            answers = [
                self._answer(*self._network.match(template, features), window.shape)
                for template in (*templates, *distractors)
            ]
            scores, boxes = (torch.stack(parts).numpy() for parts in zip(*answers, strict=True))
            return Answers(scores, boxes[: len(templates)])

    def _answer(
        self, scores: torch.Tensor, changes: torch.Tensor, shape: tuple[int, ...]
    ) -> tuple[torch.Tensor, torch.Tensor]:
        boxes = siamrpn.boxes_of(changes, (shape[1], shape[0]))
        if self._every_anchor:
            return scores, boxes
        best, index = scores.max(0)
        return best, boxes.gather(1, index.expand(4, 1, -1, -1))[:, 0]


class SiamFcMatcher:
    """SiamFC, the published or the small one."""

    def __init__(self, network: SiamFc) -> None:
        self.geometry = network.layout.geometry
        self._network = fused(network)
        # The first run sets the library up: not in the middle of a stream.
        blank = np.zeros((self.geometry.instance_side, self.geometry.instance_side), np.uint8)
        side = self.geometry.exemplar_side
        self.responses([blank], self.template(blank[:side, :side]))

    def template(self, exemplar: Picture) -> torch.Tensor:
        with torch.inference_mode():
            return self._network.features(self._crops([exemplar]))

    def responses(self, windows: Sequence[Picture], template: torch.Tensor) -> Responses:
        with torch.inference_mode():
            features = self._network.features(self._crops(windows))
            kernels = template.expand(len(windows), -1, -1, -1).contiguous()
            responses: Responses = self._network.respond(kernels, features).numpy()
            return responses

    def _crops(self, pictures: Sequence[Picture]) -> torch.Tensor:
        """As the network takes them: grey, or RGB as the published files were trained."""
        if self._network.layout.widths[0] == 1:
            return torch.cat([_grey(picture) for picture in pictures])
        return torch.cat([siamrpn.as_bgr(picture).flip(1) for picture in pictures])


def fused(network: Network) -> Network:
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


def _grey(pixels: Picture) -> torch.Tensor:
    if pixels.ndim == 3:
        pixels = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), np.uint8)
    return torch.from_numpy(np.ascontiguousarray(pixels)).float()[None, None]
