"""What the training asks of a network that it trains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt
from torch import Tensor, nn

BatchT = TypeVar("BatchT")
BatchT_co = TypeVar("BatchT_co", covariant=True)
TensorsT = TypeVar("TensorsT")


class Cache(Protocol):
    """Sequences by number, each made once; numbers are their seeds. It is pickled for other processes."""

    def has(self, seed: int) -> bool:
        """Whether a sequence has been made."""
        ...

    def make(self, seed: int) -> None:
        """Make a sequence unless it is there."""
        ...


class Sampler(Protocol[BatchT_co]):
    """Draws batches; every batch depends on its generator alone. It is pickled for other processes."""

    def batch(self, rng: np.random.Generator, seeds: npt.NDArray[np.int64], count: int) -> BatchT_co:
        """`count` examples from the sequences of `seeds`.

        Raises:
            TrainingError: a sequence is missing or damaged.
        """
        ...


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


class Lesson(Protocol[BatchT, TensorsT]):
    """A network, the batches that it learns from, its loss and its figures.

    Attributes:
        name: the network's.
        weights_name: of the file in which its weights are kept.
    """

    name: str
    weights_name: str

    @property
    def loss_names(self) -> tuple[str, ...]:
        """Of the parts of its loss."""
        ...

    @property
    def network(self) -> nn.Module:
        """On the training's device."""
        ...

    @property
    def sampler(self) -> Sampler[BatchT]:
        """Draws its batches."""
        ...

    def tensors(self, batch: BatchT) -> TensorsT:
        """The batch as the network takes it, on the training's device."""
        ...

    def losses(self, batch: TensorsT) -> Losses:
        """The network's loss on a batch."""
        ...

    def validate(self, batches: Sequence[TensorsT]) -> Figures:
        """Figures over batches that it was not trained on; the network is in training mode again afterwards."""
        ...

    def load(self, path: Path) -> None:
        """Take the weights of a file.

        Raises:
            EtdError: no readable weights of this network.
        """
        ...

    def save(self, path: Path, about: Mapping[str, str]) -> None:
        """Write its weights; `about` goes into the file's metadata."""
        ...
