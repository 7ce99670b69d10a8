"""SiamFC (Bertinetto et al. 2016): an exemplar correlated with a window, both seen by the same convolutions.

Two networks of one build: the published AlexNet, with the layers and names of its public PyTorch files, so that they
load; and a small one, whose weights ship. Neither pads inside, so that a place's answer depends on nothing but what is
seen there (Sec. 2.2).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from torch import Tensor, nn
from torch.nn import functional

from etd_ros.recovery.published_weights import Origin, load_published, published_state
from etd_ros.recovery.siamfc_tracking import PUBLISHED_GEOMETRY, SMALL_GEOMETRY, SiamFcGeometry
from etd_ros.recovery.weights_file import WEIGHTS, load_weights, save_weights

SHIPPED = WEIGHTS / "siamfc.safetensors"
SIAMFC = "etd_ros siamfc 1"
"""In a file's metadata: another layout of layers gets another number."""
ORIGIN = Origin(
    "SiamFC", "siamfc_model", "siamfc_alexnet_e50.pth", "a siamfc.safetensors made by `train --network siamfc`"
)
NORMALISATION_EPS, NORMALISATION_MOMENTUM = 1e-6, 0.05
DEVIATION_MIN = 8.0
"""Grey levels: crops with less contrast are not amplified to full contrast, they hold mostly noise."""


class Layout(NamedTuple):
    """What tells one SiamFC from another.

    Attributes:
        geometry: of its crops and its response.
        widths: channels of a crop, and of each of the five convolutions.
        first_kernel: side of the first convolution, of stride 2; the others are 5, 3, 3 and 3.
        groups: of the second, fourth and fifth convolution.
        pools: how many of the first two convolutions a 3x3 maximum of stride 2 follows.
        response_scale: what a correlation is multiplied by.
        is_normalised: whether crops are brought to mean 0 and deviation 1 first.
    """

    geometry: SiamFcGeometry
    widths: tuple[int, int, int, int, int, int]
    first_kernel: int
    groups: int
    pools: int
    response_scale: float
    is_normalised: bool


PUBLISHED = Layout(PUBLISHED_GEOMETRY, (3, 96, 256, 384, 384, 256), 11, 2, 2, 0.001, is_normalised=False)
"""Table 1 of the paper; 2.3 M parameters. Crops are RGB."""
SMALL = Layout(SMALL_GEOMETRY, (1, 24, 64, 96, 96, 64), 7, 1, 1, 0.01, is_normalised=True)
"""The same on crops of half the side and half the stride: objects on event cameras are seldom larger than that."""


class SiamFc(nn.Module):
    """The network. Crops are grey levels 0..255, float32, shape (n, channels, rows, columns)."""

    def __init__(self, layout: Layout = PUBLISHED) -> None:
        super().__init__()
        self.layout = layout
        kernels, strides = (layout.first_kernel, 5, 3, 3, 3), (2, 1, 1, 1, 1)
        groups = (1, layout.groups, 1, layout.groups, layout.groups)
        # The names are those of the published files.
        self.backbone = nn.Sequential()
        for index in range(5):
            inputs, outputs = layout.widths[index : index + 2]
            layers: list[nn.Module] = [
                nn.Conv2d(inputs, outputs, kernels[index], strides[index], groups=groups[index]),
            ]
            # The last convolution's answer is correlated as it is.
            if index < 4:
                layers += [
                    nn.BatchNorm2d(outputs, eps=NORMALISATION_EPS, momentum=NORMALISATION_MOMENTUM),
                    nn.ReLU(inplace=True),
                ]
            if index < layout.pools:
                layers.append(nn.MaxPool2d(3, 2))
            self.backbone.add_module(f"conv{index + 1}", nn.Sequential(*layers))
        for module in self.backbone.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")
                assert module.bias is not None
                nn.init.zeros_(module.bias)

    def features(self, crops: Tensor) -> Tensor:
        """What is correlated: of exemplars the kernels, of windows the map they are moved over."""
        if self.layout.is_normalised:
            mean = crops.mean((1, 2, 3), keepdim=True)
            deviation = crops.std((1, 2, 3), keepdim=True).clamp(min=DEVIATION_MIN)
            crops = (crops - mean) / deviation
        features: Tensor = self.backbone(crops)
        return features

    def respond(self, kernels: Tensor, features: Tensor) -> Tensor:
        """Logits of the target's centre being at each place (Eq. 2), shape (n, rows, columns).

        Args:
            kernels: of an exemplar for each window, shape (n, channels, rows, columns).
            features: of the windows, shape (n, channels, rows, columns).
        """
        count, width, rows, columns = features.shape
        correlation = functional.conv2d(features.reshape(1, count * width, rows, columns), kernels, groups=count)
        return correlation[0] * self.layout.response_scale

    def forward(self, exemplars: Tensor, windows: Tensor) -> Tensor:
        return self.respond(self.features(exemplars), self.features(windows))


def save_small(network: SiamFc, path: Path, about: Mapping[str, str]) -> None:
    """Write the weights of a small SiamFC; `about` goes into the file's metadata."""
    save_weights(network, SIAMFC, path, about)


def load_siamfc(path: Path = SHIPPED) -> SiamFc:
    """The network with the weights of a file, for inference.

    Args:
        path: of the small one where it ends in `.safetensors`, as `train` makes them; else of the published one.

    Raises:
        RecoveryError: no readable file, or not of this network.
    """
    if path.suffix == SHIPPED.suffix:
        network = SiamFc(SMALL)
        load_weights(network, SIAMFC, path)
    else:
        network = SiamFc(PUBLISHED)
        load_published(network, published_state(path, ORIGIN), path, ORIGIN)
    return network.eval()
