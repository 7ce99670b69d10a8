"""What the training asks of a network that it trains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from torch import Tensor, nn


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
    """

    name: str

    @property
    def loss_names(self) -> tuple[str, ...]:
        """Of the parts of its loss."""
        ...

    @property
    def network(self) -> nn.Module:
        """On the training's device."""
        ...

    def batch(self, rng: np.random.Generator, seeds: npt.NDArray[np.int64], count: int) -> Any:
        """`count` pairs from the sequences of `seeds`, on the device; `rng` decides everything."""
        ...

    def losses(self, batch: Any) -> Losses:
        """The network's loss on a batch."""
        ...

    def validate(self, batches: Sequence[Any]) -> Figures:
        """Figures over batches that it was not trained on; the network is in training mode again afterwards."""
        ...

    def save(self, path: Path, about: Mapping[str, str]) -> None:
        """Write its weights; `about` goes into the file's metadata."""
        ...
