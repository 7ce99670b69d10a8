"""The compact recovery network as something to train."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from etd_ros.recovery.compact import Compact
from etd_ros.recovery.training.config import AugmentationConfig
from etd_ros.recovery.training.loss import Losses, compare, losses_of
from etd_ros.recovery.training.pairs import Batch, PairSampler
from etd_ros.recovery.training.sequences import SequenceCache
from etd_ros.recovery.training.validation import Figures, Tensors, placed, tensors_of, validate
from etd_ros.recovery.weights_file import COMPACT, load_weights, save_compact


class CompactLesson:
    """A `Lesson`.

    Args:
        cache: its sequences of reconstructed images.
        device: where it is trained.
        augmentation: how pairs are made harder.
    """

    name = "compact"
    weights_name = "compact.safetensors"
    loss_names = Losses._fields

    def __init__(
        self, cache: SequenceCache, device: torch.device, augmentation: AugmentationConfig | None = None
    ) -> None:
        self._device = device
        self.network = placed(Compact(), device)
        self.sampler = PairSampler(cache.sequence, augmentation)

    def tensors(self, batch: Batch) -> Tensors:
        return tensors_of(batch, self._device)

    def losses(self, batch: Tensors) -> Losses:
        comparison = compare(self.network, batch.exemplars, batch.sizes, batch.windows)
        return losses_of(comparison, batch.sizes, batch.boxes, batch.visible)

    def validate(self, batches: Sequence[Tensors]) -> Figures:
        return validate(self.network, batches)

    def load(self, path: Path) -> None:
        load_weights(self.network, COMPACT, path)

    def save(self, path: Path, about: Mapping[str, str]) -> None:
        save_compact(self.network, path, about)
