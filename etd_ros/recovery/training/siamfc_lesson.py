"""The small SiamFC as something to train (Bertinetto et al. 2016, Sec. 2.2 and 3.1), on video frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from etd_ros.recovery.siamfc import SIAMFC, SMALL, SiamFc, save_small
from etd_ros.recovery.siamfc_tracking import SMALL_GEOMETRY
from etd_ros.recovery.training.config import AugmentationConfig
from etd_ros.recovery.training.pairs import HIDDEN_MAX, SEEN_MIN, Batch, Crops, PairSampler
from etd_ros.recovery.training.sequences import SequenceCache
from etd_ros.recovery.training.validation import Tensors, placed, tensors_of
from etd_ros.recovery.weights_file import load_weights

CROPS = Crops(SMALL_GEOMETRY.exemplar_side, SMALL_GEOMETRY.instance_side, follows_size=True)
AUGMENTATION = AugmentationConfig(shift_px=24.0, scale=0.05, box_noise=0.04, elsewhere=0.0)
"""A tracker's window follows its target: it is near the middle, and nearly of the exemplar's size."""
RADIUS_CELLS = 2.0
"""Places no farther from the target's centre are positive: 16 pixels of stride 8 (Eq. 4)."""


class Loss(NamedTuple):
    """The one part of the loss."""

    score: Tensor

    @property
    def total(self) -> Tensor:
        return self.score


class Figures(NamedTuple):
    """What validation tells.

    Attributes:
        loss: the training's loss.
        error_cells: mean distance of the likeliest place to the target's centre (cells), where the target can be seen.
        found: share of those within the positive radius.
    """

    loss: float
    error_cells: float
    found: float

    def told(self) -> str:
        return f"found {self.found:.3f}, mean error {self.error_cells:.2f} cells"


class SiamFcLesson:
    """A `Lesson`.

    Args:
        cache: its sequences of video frames.
        device: where it is trained.
    """

    name = "siamfc"
    weights_name = "siamfc.safetensors"
    loss_names = Loss._fields

    def __init__(self, cache: SequenceCache, device: torch.device) -> None:
        self._device = device
        self.network = placed(SiamFc(SMALL), device)
        self.sampler = PairSampler(cache.sequence, AUGMENTATION, CROPS)

    def tensors(self, batch: Batch) -> Tensors:
        return tensors_of(batch, self._device)

    def losses(self, batch: Tensors) -> Loss:
        logits = self.network(batch.exemplars, batch.windows)
        return Loss(balanced_logistic_loss(logits, distances_cells(batch.boxes), batch.visible))

    def validate(self, batches: Sequence[Tensors]) -> Figures:
        self.network.eval()
        with torch.inference_mode():
            rows = [self._answers(batch) for batch in batches]
        self.network.train()
        errors = torch.cat([row[1] for row in rows])
        return Figures(
            float(np.mean([row[0] for row in rows])),
            float(errors.mean()) if len(errors) else 0.0,
            float((errors <= RADIUS_CELLS).float().mean()) if len(errors) else 0.0,
        )

    def load(self, path: Path) -> None:
        load_weights(self.network, SIAMFC, path)

    def save(self, path: Path, about: Mapping[str, str]) -> None:
        save_small(self.network, path, about)

    def _answers(self, batch: Tensors) -> tuple[float, Tensor]:
        """The loss, and how far (cells) the likeliest place is from each target that can be seen, shape (m,)."""
        logits = self.network(batch.exemplars, batch.windows)
        distances = distances_cells(batch.boxes)
        loss = balanced_logistic_loss(logits, distances, batch.visible)
        best = logits.flatten(1).argmax(1, keepdim=True)
        return float(loss), distances.flatten(1).gather(1, best)[batch.visible >= SEEN_MIN, 0]


def distances_cells(boxes: Tensor) -> Tensor:
    """Distance of each place from the target's centre, in strides, shape (n, places down, places across).

    Args:
        boxes: as in `Batch`, shape (n, 4).
    """
    geometry = SMALL_GEOMETRY
    steps = torch.arange(geometry.response_side, dtype=boxes.dtype, device=boxes.device)
    centers = geometry.instance_side / 2 + geometry.stride * (steps - (geometry.response_side - 1) / 2)
    offset_x = centers - boxes[:, :1]
    offset_y = centers - boxes[:, 1:2]
    return torch.hypot(offset_x[:, None, :], offset_y[:, :, None]) / geometry.stride


def balanced_logistic_loss(logits: Tensor, distances: Tensor, visible: Tensor) -> Tensor:
    """Mean logistic loss of the places (Eq. 1 and 3), positive and negative ones with half of the weight each.

    Args:
        logits: shape (n, rows, columns).
        distances: of the places from the targets' centres (cells), the same shape.
        visible: share of each target that can be seen, shape (n,); a hidden one makes its places negative, those round
            a half-hidden one are left out.
    """
    near = distances <= RADIUS_CELLS
    seen, hidden = (visible >= SEEN_MIN)[:, None, None], (visible <= HIDDEN_MAX)[:, None, None]
    positive, negative = near & seen, ~near | hidden
    losses_positive = functional.softplus(-logits)[positive]
    losses_negative = functional.softplus(logits)[negative]
    return (losses_positive.sum() / max(1, len(losses_positive)) + losses_negative.mean()) / 2
