"""What the training asks of a network that it trains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from torch import Tensor, nn

from etd_ros.recovery.training.pairs import PairSampler
from etd_ros.recovery.training.validation import Tensors


class Losses(Protocol):
    """Parts of a loss, scalars; a named tuple."""

    def __iter__(self) -> Iterator[Tensor]: ...

    @property
    def total(self) -> Tensor:
        """What is made smaller."""
        ...


class Figures(Protocol):
    """What a validation tells; a named tuple of numbers."""

    @property
    def _fields(self) -> tuple[str, ...]: ...

    def __iter__(self) -> Iterator[float]: ...

    def _asdict(self) -> dict[str, float]: ...

    def told(self) -> str:
        """The figures to watch, in a line."""
        ...


class Lesson(Protocol):
    """A network, the pairs that it learns from, its loss and its figures.

    Attributes:
        name: the network's; its weights are kept in `<name>.safetensors`.
        sampler: draws its pairs; may be handed to other processes.
    """

    name: str
    sampler: PairSampler

    @property
    def loss_names(self) -> tuple[str, ...]:
        """Of the parts of its loss."""
        ...

    @property
    def network(self) -> nn.Module:
        """On the training's device."""
        ...

    def losses(self, batch: Tensors) -> Losses:
        """The network's loss on a batch."""
        ...

    def validate(self, batches: Sequence[Tensors]) -> Figures:
        """Figures over batches that it was not trained on; the network is in training mode again afterwards."""
        ...

    def load(self, path: Path) -> None:
        """Take the weights of a file.

        Raises:
            RecoveryError: no readable weights of this network.
        """
        ...

    def save(self, path: Path, about: Mapping[str, str]) -> None:
        """Write its weights; `about` goes into the file's metadata."""
        ...
