"""The compact Siamese network: a small depthwise backbone on grey crops, matched by depthwise cross-correlation.

It has no anchors of fixed shapes: at each place it tells whether the target's centre is there (Tian et al. 2019) and
how the box there differs from the remembered one, which is known in size and so serves as the only anchor.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from etd_ros.recovery.matching import COMPACT_GEOMETRY

EXEMPLAR_SIDE = COMPACT_GEOMETRY.exemplar_side
INSTANCE_SIDE = 128
STRIDE = 8
KERNEL_CELLS = 6
"""Cells a side of the exemplar's middle that are correlated: the target and a rim of its surroundings."""
FIRST_CENTER = STRIDE * KERNEL_CELLS / 2
"""Column and row of the first place on the window (pixels)."""
DEVIATION_MIN = 8.0
"""Grey levels: crops with less contrast are not amplified to full contrast, they hold mostly noise."""

BACKBONE_WIDTH = 96
BLOCKS = 8
EXPANSION = 2
WIDTH = 96
LOG_RATIO_MAX = 1.5


class Kernels(NamedTuple):
    """An exemplar as the network remembers it: float32, shape (n, WIDTH, KERNEL_CELLS, KERNEL_CELLS) each."""

    score: Tensor
    box: Tensor


class Windows(NamedTuple):
    """Windows as exemplars are compared with them: float32, shape (n, WIDTH, rows / 8, columns / 8) each."""

    score: Tensor
    box: Tensor


class Response(NamedTuple):
    """What the network says about every place of a window.

    Attributes:
        logits: of the target's centre being there, float32, shape (n, rows, columns).
        changes: box there relative to the exemplar's, float32, shape (n, 4, rows, columns): shift of the centre in
            strides (x, y), logarithm of the ratios of width and height.
    """

    logits: Tensor
    changes: Tensor


def _conv(inputs: int, outputs: int, kernel: int, *, stride: int = 1, groups: int = 1) -> list[nn.Module]:
    conv = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False)
    return [conv, nn.BatchNorm2d(outputs)]


class Bottleneck(nn.Module):
    """Inverted residual block (Sandler et al. 2018): widen, filter each channel, narrow."""

    def __init__(self, width: int) -> None:
        super().__init__()
        hidden = EXPANSION * width
        self.layers = nn.Sequential(
            *_conv(width, hidden, 1),
            nn.ReLU(inplace=True),
            *_conv(hidden, hidden, 3, groups=hidden),
            nn.ReLU(inplace=True),
            *_conv(hidden, width, 1),
        )

    def forward(self, x: Tensor) -> Tensor:
        y: Tensor = self.layers(x)
        return x + y


class _Branch(nn.Module):
    """Correlation of exemplar and window, and what is read from it."""

    def __init__(self, outputs: int) -> None:
        super().__init__()
        # The exemplar's neck also sees which of its cells belong to the target.
        self.exemplar_neck = nn.Sequential(*_conv(BACKBONE_WIDTH + 1, WIDTH, 3))
        self.window_neck = nn.Sequential(*_conv(BACKBONE_WIDTH, WIDTH, 1))
        self.head = nn.Sequential(
            *_conv(WIDTH, WIDTH, 1),
            nn.ReLU(inplace=True),
            *_conv(WIDTH, WIDTH, 3, groups=WIDTH),
            nn.ReLU(inplace=True),
            nn.Conv2d(WIDTH, outputs, 1),
        )

    def kernel(self, features: Tensor, mask: Tensor) -> Tensor:
        rim = (features.shape[-1] - KERNEL_CELLS) // 2
        kernel: Tensor = self.exemplar_neck(torch.cat([features, mask], 1))[..., rim:-rim, rim:-rim]
        # Their correlation is a sum over the cells: a scale that keeps it near the window's own.
        return kernel / KERNEL_CELLS

    def window(self, features: Tensor) -> Tensor:
        window: Tensor = self.window_neck(features)
        return window

    def forward(self, kernel: Tensor, window: Tensor) -> Tensor:
        count, width, rows, columns = window.shape
        correlation = functional.conv2d(
            window.reshape(1, count * width, rows, columns),
            kernel.reshape(count * width, 1, *kernel.shape[-2:]),
            groups=count * width,
        )
        answer: Tensor = self.head(correlation.view(count, width, *correlation.shape[-2:]))
        return answer


class Compact(nn.Module):
    """The network. Crops are float32 grey levels 0..255, shape (n, 1, rows, columns), sides multiples of 8."""

    def __init__(self) -> None:
        super().__init__()
        self.backbone = nn.Sequential(
            *_conv(1, 16, 3, stride=2),
            nn.ReLU(inplace=True),
            *_conv(16, 32, 3, stride=2),
            nn.ReLU(inplace=True),
            *_conv(32, BACKBONE_WIDTH, 3, stride=2),
            *(Bottleneck(BACKBONE_WIDTH) for _ in range(BLOCKS)),
        )
        self.score = _Branch(1)
        self.box = _Branch(4)
        last = self.score.head[-1]
        assert isinstance(last, nn.Conv2d)
        assert last.bias is not None
        # Nearly all places are background: begin by saying so (Lin et al. 2017, Sec. 3.3).
        nn.init.constant_(last.bias, -4.0)

    def features(self, crops: Tensor) -> Tensor:
        """Features of crops, float32, shape (n, BACKBONE_WIDTH, rows / 8, columns / 8)."""
        mean = crops.mean((1, 2, 3), keepdim=True)
        deviation = crops.std((1, 2, 3), keepdim=True).clamp(min=DEVIATION_MIN)
        features: Tensor = self.backbone((crops - mean) / deviation)
        return features

    def remember(self, crops: Tensor, sizes: Tensor) -> Kernels:
        """Exemplars of targets in the middle of crops.

        Args:
            crops: float32, shape (n, 1, EXEMPLAR_SIDE, EXEMPLAR_SIDE).
            sizes: width and height of the targets on the crops (pixels), float32, shape (n, 2).
        """
        features = self.features(crops)
        mask = target_mask(sizes)
        return Kernels(self.score.kernel(features, mask), self.box.kernel(features, mask))

    def look(self, crops: Tensor) -> Windows:
        """Windows, to be compared with any number of exemplars."""
        features = self.features(crops)
        return Windows(self.score.window(features), self.box.window(features))

    def likeness(self, kernels: Kernels, windows: Windows) -> Tensor:
        """The logits alone of one exemplar with one window, n times; shape (n, rows, columns)."""
        logits: Tensor = self.score(kernels.score, windows.score)[:, 0]
        return logits

    def match(self, kernels: Kernels, windows: Windows) -> Response:
        """The response of one exemplar with one window, n times."""
        return Response(self.likeness(kernels, windows), self.box(kernels.box, windows.box))

    def forward(self, exemplars: Tensor, sizes: Tensor, windows: Tensor) -> Response:
        return self.match(self.remember(exemplars, sizes), self.look(windows))


def target_mask(sizes: Tensor) -> Tensor:
    """The share of each of an exemplar's cells that the target's box covers, shape (n, 1, 8, 8).

    Args:
        sizes: width and height of the targets (pixels of the crop), float32, shape (n, 2).
    """
    edges = torch.arange(0, EXEMPLAR_SIDE + 1, STRIDE, dtype=sizes.dtype, device=sizes.device) - EXEMPLAR_SIDE / 2
    half = sizes[:, :, None] / 2
    covered = torch.minimum(edges[1:], half) - torch.maximum(edges[:-1], -half)
    shares = covered.clamp(min=0) / STRIDE
    return (shares[:, 1, :, None] * shares[:, 0, None, :])[:, None]


def place_centers(count: int, *, device: torch.device | None = None) -> Tensor:
    """Column (or row) of the first `count` places on the window (pixels), shape (count,)."""
    return FIRST_CENTER + STRIDE * torch.arange(count, dtype=torch.float32, device=device)


def boxes_of(changes: Tensor, sizes: Tensor) -> Tensor:
    """Boxes as centre x, y, width, height on the window (pixels), shape (n, 4, rows, columns).

    Args:
        changes: as in `Response`.
        sizes: width and height of the remembered targets (pixels of the crop), shape (n, 2).
    """
    rows, columns = changes.shape[-2:]
    x = place_centers(columns, device=changes.device) + STRIDE * changes[:, 0]
    y = place_centers(rows, device=changes.device)[:, None] + STRIDE * changes[:, 1]
    ratios = changes[:, 2:].clamp(-LOG_RATIO_MAX, LOG_RATIO_MAX).exp()
    return torch.cat([x[:, None], y[:, None], sizes[:, :, None, None] * ratios], 1)
