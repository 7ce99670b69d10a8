"""The compact recovery network as something to train."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch

from etd_ros.recovery.compact import Compact
from etd_ros.recovery.training.config import AugmentationConfig
from etd_ros.recovery.training.loss import Losses, losses_of
from etd_ros.recovery.training.pairs import PairSampler
from etd_ros.recovery.training.sequences import SequenceCache
from etd_ros.recovery.training.validation import Figures, Tensors, tensors_of, validate
from etd_ros.recovery.weights_file import save_compact


class CompactLesson:
    """A `Lesson`.

    Args:
        cache: its sequences of reconstructed images.
        device: where it is trained.
        augmentation: how pairs are made harder.
    """

    name = "compact"
    loss_names = Losses._fields

    def __init__(
        self, cache: SequenceCache, device: torch.device, augmentation: AugmentationConfig | None = None
    ) -> None:
        self.network = Compact().to(device)
        self._device = device
        self._sampler = PairSampler(cache.sequence, augmentation)

    def batch(self, rng: np.random.Generator, seeds: npt.NDArray[np.int64], count: int) -> Tensors:
        return tensors_of(self._sampler.batch(rng, seeds, count), self._device)

    def losses(self, batch: Tensors) -> Losses:
        kernels, features = self.network.remember(batch.exemplars, batch.sizes), self.network.features(batch.windows)
        response = self.network.match(kernels, features)
        # The neighbour's exemplar is of another sequence: a negative pair for the price of a correlation.
        others = self.network.score(kernels.score.roll(1, 0), features)[:, 0]
        return losses_of(response, others, batch.sizes, batch.boxes, batch.visible)

    def validate(self, batches: Sequence[Tensors]) -> Figures:
        return validate(self.network, batches)

    def save(self, path: Path, about: Mapping[str, str]) -> None:
        save_compact(self.network, path, about)
