"""DaSiamRPN (Zhu et al. 2018) with the layers and names of the published models, so that their files load."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from etd_ros.recovery.crops import Picture
from etd_ros.recovery.interface import RecoveryError
from etd_ros.recovery.published_weights import Origin, load_published, published_state

STRIDE = 8
ANCHORS = ((104, 32), (88, 40), (64, 64), (40, 80), (32, 96))
"""Width and height (pixels of the window)."""
DASIAMRPN = Origin("DaSiamRPN", "siamrpn_model", "SiamRPNVOT.model", "another .model of it")
LOG_RATIO_MAX = 4.0
SIZES = {256: (1, 256), 512: (2, 512)}
"""Backbone width (times the narrow one's) and head width, by the channels that the backbone gives: VOT, OTB; BIG."""


class Kernels(NamedTuple):
    """An exemplar: correlation kernels of the boxes, shape (20, width, 4, 4), and of the scores, (10, width, 4, 4)."""

    box: Tensor
    score: Tensor


class SiamRpn(nn.Module):
    """The network. Crops are BGR grey levels 0..255, float32, shape (n, 3, rows, columns), without padding inside.

    Args:
        size: width of the backbone: 1 (SiamRPNVOT, SiamRPNOTB) or 2 (SiamRPNBIG).
        width: channels of the heads, 256 or 512.
    """

    def __init__(self, size: int = 1, width: int = 256) -> None:
        super().__init__()
        channels = [3, *(size * count for count in (96, 256, 384, 384, 256))]
        kernels, strides = (11, 5, 3, 3, 3), (2, 1, 1, 1, 1)
        layers: list[nn.Module] = []
        for index, (kernel, stride) in enumerate(zip(kernels, strides, strict=True)):
            layers += [nn.Conv2d(channels[index], channels[index + 1], kernel, stride)]
            layers += [nn.BatchNorm2d(channels[index + 1])]
            layers += [nn.MaxPool2d(3, 2)] if index < 2 else []
            layers += [nn.ReLU(inplace=True)] if index < 4 else []
        count, last = len(ANCHORS), channels[-1]
        # The names are those of the published files.
        self.featureExtract = nn.Sequential(*layers)
        self.conv_r1 = nn.Conv2d(last, width * 4 * count, 3)
        self.conv_r2 = nn.Conv2d(last, width, 3)
        self.conv_cls1 = nn.Conv2d(last, width * 2 * count, 3)
        self.conv_cls2 = nn.Conv2d(last, width, 3)
        self.regress_adjust = nn.Conv2d(4 * count, 4 * count, 1)

    def remember(self, exemplar: Tensor) -> Kernels:
        """The kernels of one exemplar, shape (1, 3, 127, 127)."""
        features = self.featureExtract(exemplar)
        box, score = self.conv_r1(features)[0], self.conv_cls1(features)[0]
        count = len(ANCHORS)
        return Kernels(box.view(4 * count, -1, *box.shape[1:]), score.view(2 * count, -1, *score.shape[1:]))

    def window(self, crop: Tensor) -> tuple[Tensor, Tensor]:
        """What of a window, shape (1, 3, rows, columns), is correlated with the kernels of boxes and of scores."""
        features = self.featureExtract(crop)
        return self.conv_r2(features), self.conv_cls2(features)

    def match(self, kernels: Kernels, window: tuple[Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        """Scores 0 to 1, shape (5, rows, columns), and changes of the anchors, (4, 5, rows, columns), of an exemplar
        with a window; places are 8 pixels apart, the middle one in the middle of the window."""
        changes: Tensor = self.regress_adjust(functional.conv2d(window[0], kernels.box))[0]
        logits = functional.conv2d(window[1], kernels.score)[0]
        rows, columns = logits.shape[-2:]
        count = len(ANCHORS)
        scores = logits.view(2, count, rows, columns).softmax(0)[1]
        return scores, changes.view(4, count, rows, columns)


def boxes_of(changes: Tensor, size: tuple[int, int]) -> Tensor:
    """Boxes as centre x, y, width, height on a window, shape (4, 5, rows, columns).

    Args:
        changes: of the anchors, the same shape.
        size: columns and rows of the window (pixels).
    """
    rows, columns = changes.shape[-2:]
    x = size[0] / 2 + STRIDE * (torch.arange(columns) - (columns - 1) / 2)
    y = (size[1] / 2 + STRIDE * (torch.arange(rows) - (rows - 1) / 2))[:, None]
    widths, heights = torch.tensor(ANCHORS, dtype=torch.float32).T[:, :, None, None]
    ratios = changes[2:].clamp(-LOG_RATIO_MAX, LOG_RATIO_MAX).exp()
    return torch.stack([x + changes[0] * widths, y + changes[1] * heights, widths * ratios[0], heights * ratios[1]])


def load_siamrpn(path: Path) -> SiamRpn:
    """The network with the weights of a published file (SiamRPNVOT, SiamRPNOTB or SiamRPNBIG), for inference.

    The file is read as plain numbers: no code in it is run.

    Raises:
        RecoveryError: no readable file, not a file of weights, or of another network.
    """
    state = published_state(path, DASIAMRPN)
    network = _shaped_like(state, path)
    load_published(network, state, path, DASIAMRPN)
    return network.eval()


def _shaped_like(state: dict[str, Tensor], path: Path) -> SiamRpn:
    weights = state.get("conv_r1.weight")
    channels = int(weights.shape[1]) if weights is not None and weights.dim() == 4 else 0
    if channels not in SIZES:
        msg = f"{path}: conv_r1.weight is of none of DaSiamRPN's networks: give SiamRPNVOT, OTB or BIG"
        raise RecoveryError(msg)
    return SiamRpn(*SIZES[channels])


def as_bgr(pixels: Picture) -> Tensor:
    """A crop, grey or BGR, uint8, as the network takes it, float32, shape (1, 3, rows, columns)."""
    crop = torch.from_numpy(np.ascontiguousarray(pixels)).float()
    return crop.permute(2, 0, 1)[None] if crop.dim() == 3 else crop.expand(1, 3, -1, -1)
