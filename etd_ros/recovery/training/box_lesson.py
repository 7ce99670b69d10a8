"""The network that puts boxes right, as something to train."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn
from torch.nn import functional

from etd_ros.boxes import Box
from etd_ros.recovery.training.box_samples import SampleCache, misfit_of
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.recovery.training.loss import intersection_over_union
from etd_ros.tracking.box_network import (
    HIDDEN,
    LAYERS,
    OFFSET_UNIT,
    SPREAD_LIMITS,
    SPREAD_UNIT,
    read_weights,
    weight_shapes,
)
from etd_ros.tracking.box_view import CELLS, CHANNELS, FIRST_SPAN, NUMBERS, USUAL_SPAN, BoxView
from etd_ros.tracking.box_view_kernels import move_picture
from etd_ros.tracking.contour_kernels import Float32Array, Float64Array

OTHERWISE_SHARE, OTHERWISE_SHIFT, OTHERWISE_SIZE, OTHERWISE_ASPECT = 0.6, 0.03, 0.07, 0.03
"""Of examples, those of a start box that was another part of the thing; standard deviations of how it lay on it, in
parts of its size. What a user calls the thing's box is not always its outline."""
MOVED_SHARE, MOVED, RESIZED, STRETCHED, VELOCITY_OFF = 0.75, 0.12, 0.14, 0.05, 0.03
"""Of examples, those whose box is moved and resized; the largest standard deviations, in parts of its size."""
DROPOUT = 0.15
LOSS_MAX = 8.0
"""Of one offset: a few boxes that have drifted away must not decide the rest."""


class BoxBatch(NamedTuple):
    """Examples: maps, float32, shape (n, CHANNELS, CELLS, CELLS), numbers, shape (n, NUMBERS), and how far the boxes
    are off, shape (n, 4)."""

    maps: Float32Array
    numbers: Float32Array
    misfits: Float32Array


class BoxTensors(NamedTuple):
    """A `BoxBatch` on a device."""

    maps: Tensor
    numbers: Tensor
    misfits: Tensor


class Loss(NamedTuple):
    """The one part of the loss: the negative logarithm of the misfits' likelihood (Laplace)."""

    likelihood: Tensor

    @property
    def total(self) -> Tensor:
        return self.likelihood


class Figures(NamedTuple):
    """What validation tells.

    Attributes:
        loss: the training's.
        before, after: mean IoU of the boxes with the right ones as they are, and put right.
    """

    loss: float
    before: float
    after: float

    def told(self) -> str:
        return f"loss {self.loss:.3f}, mean IoU {self.before:.4f} -> {self.after:.4f}"


class BoxNet(nn.Module):
    """`BoxNetwork` in torch."""

    def __init__(self) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList(nn.Conv2d(before, after, 3, step, 1) for before, after, step in LAYERS)
        self.hidden = nn.Linear(weight_shapes()["hidden"][1], HIDDEN)
        self.output = nn.Linear(HIDDEN, 8)
        nn.init.normal_(self.output.weight, 0, 0.01)
        nn.init.zeros_(self.output.bias)

    def forward(self, maps: Tensor, numbers: Tensor) -> tuple[Tensor, Tensor]:
        """Offsets and the logarithms of their spreads, shape (n, 4) each."""
        layer = maps
        for convolution in self.convolutions:
            layer = functional.relu(convolution(layer))
        seen = functional.dropout(layer.flatten(1), DROPOUT, self.training)
        output = self.output(functional.relu(self.hidden(torch.cat([seen, numbers], 1))))
        offsets, spreads = output.chunk(2, 1)
        return offsets * OFFSET_UNIT, (spreads + SPREAD_UNIT).clamp(*SPREAD_LIMITS)

    def named_weights(self) -> dict[str, Tensor]:
        """Its weights by the names of `weight_shapes`."""
        layers = {f"convolution_{number}": layer for number, layer in enumerate(self.convolutions)}
        layers |= {"hidden": self.hidden, "output": self.output}
        named: dict[str, Tensor] = {}
        for name, layer in layers.items():
            weight, bias = layer.parameters()
            named |= {name: weight, f"{name}_bias": bias}
        return named


class BoxSampler:
    """Draws views of boxes, moves the boxes, and turns what is seen over.

    Args:
        cache: of samples.
    """

    def __init__(self, cache: SampleCache) -> None:
        self._cache = cache

    def batch(self, rng: np.random.Generator, seeds: npt.NDArray[np.int64], count: int) -> BoxBatch:
        """`count` examples from the samples of `seeds`.

        Raises:
            TrainingError: samples are missing or damaged, or there are none.
        """
        batch = BoxBatch(
            np.empty((count, CHANNELS, CELLS, CELLS), np.float32),
            np.empty((count, NUMBERS), np.float32),
            np.empty((count, 4), np.float32),
        )
        for number in range(count):
            view, truth = self._drawn(rng, seeds)
            example = turned_over(*_example(view, truth, rng), rng)
            for array, part in zip(batch, example, strict=True):
                array[number] = part
        return batch

    def _drawn(self, rng: np.random.Generator, seeds: npt.NDArray[np.int64]) -> tuple[BoxView, Box]:
        empty: set[int] = set()
        while len(empty) < len(seeds):
            seed = int(rng.choice(seeds))
            samples = self._cache.samples(seed)
            # Of some scenes nothing was followed.
            if len(samples.counts):
                return samples.view(int(rng.integers(len(samples.counts))))
            empty.add(seed)
        msg = f"nothing was followed in any of {len(seeds)} simulated scenes: give more sequences"
        raise TrainingError(msg)


class BoxLesson:
    """A `Lesson`.

    Args:
        cache: its samples.
        device: where it is trained.
    """

    name = "box"
    weights_name = "box.npz"
    loss_names = Loss._fields

    def __init__(self, cache: SampleCache, device: torch.device) -> None:
        self.network = BoxNet().to(device)
        self.sampler = BoxSampler(cache)
        self._device = device

    def tensors(self, batch: BoxBatch) -> BoxTensors:
        return BoxTensors(*(torch.from_numpy(part).to(self._device) for part in batch))

    def losses(self, batch: BoxTensors) -> Loss:
        offsets, log_spreads = self.network(batch.maps, batch.numbers)
        return Loss(_likelihood(offsets, log_spreads, batch.misfits))

    def validate(self, batches: Sequence[BoxTensors]) -> Figures:
        self.network.eval()
        with torch.inference_mode():
            rows = [(*self.network(batch.maps, batch.numbers), batch.misfits) for batch in batches]
        self.network.train()
        offsets, spreads, misfits = (torch.cat(parts) for parts in zip(*rows, strict=True))
        return Figures(
            float(_likelihood(offsets, spreads, misfits)),
            float(_overlaps(torch.zeros_like(misfits), misfits).mean()),
            float(_overlaps(offsets, misfits).mean()),
        )

    def load(self, path: Path) -> None:
        weights = read_weights(path)
        with torch.no_grad():
            for name, parameter in self.network.named_weights().items():
                parameter.copy_(torch.from_numpy(weights[name]))

    def save(self, path: Path, about: Mapping[str, str]) -> None:
        named = self.network.named_weights()
        weights = {name: part.detach().cpu().numpy().astype(np.float16) for name, part in named.items()}
        told = np.array([f"{name} {value}" for name, value in about.items()])
        with path.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, about=told, **weights)


def told_otherwise(view: BoxView, truth: Box, rng: np.random.Generator) -> tuple[BoxView, Box]:
    """The same view had the start box been another part of the thing, or larger than it."""
    right, below, larger, aspect = rng.standard_normal(4) * (
        OTHERWISE_SHIFT, OTHERWISE_SHIFT, OTHERWISE_SIZE, OTHERWISE_ASPECT,
    )  # fmt: skip
    wider, higher = math.exp(larger + aspect), math.exp(larger - aspect)

    def told(box: Box) -> Box:
        x, y = box.center[0] + right * box.w, box.center[1] + below * box.h
        return Box(x - box.w * wider / 2, y - box.h * higher / 2, box.w * wider, box.h * higher)

    cells = CELLS / USUAL_SPAN
    assert len(view.first[0]) / FIRST_SPAN == cells
    usual, first = np.empty_like(view.usual), np.empty_like(view.first)
    move_picture(view.usual, right * cells, below * cells, wider, higher, usual)
    move_picture(view.first, right * cells, below * cells, wider, higher, first)
    return dataclasses.replace(view, box=told(view.box), usual=usual, first=first), told(truth)


def turned_over(
    maps: Float32Array, numbers: Float32Array, misfit: Float32Array, rng: np.random.Generator
) -> tuple[Float32Array, Float32Array, Float32Array]:
    """An example seen in a mirror, or in negative, half of the time each."""
    mirrored_x, mirrored_y, transposed, is_negative = rng.random(4) < 0.5
    numbers, misfit = numbers.copy(), misfit.copy()
    if mirrored_x:
        maps, numbers[2], misfit[0] = maps[:, :, ::-1], -numbers[2], -misfit[0]
    if mirrored_y:
        maps, numbers[3], misfit[1] = maps[:, ::-1], -numbers[3], -misfit[1]
    if transposed:
        maps, numbers, misfit = maps.transpose(0, 2, 1), numbers[[0, 1, 3, 2, 4, 5, 6, 7]], misfit[[1, 0, 3, 2]]
        numbers[5] *= -1
    if is_negative:
        maps = maps[[1, 0, 3, 2, 5, 4, 6, 7, 8, 9, 10]]
        maps[[6, 8]] *= -1
    return maps, numbers, misfit


def _example(view: BoxView, truth: Box, rng: np.random.Generator) -> tuple[Float32Array, Float32Array, Float32Array]:
    """What the network is shown of a view, and what it should say."""
    if rng.random() < OTHERWISE_SHARE:
        view, truth = told_otherwise(view, truth, rng)
    box, velocity = view.box, view.velocity
    if rng.random() < MOVED_SHARE:
        box, velocity = _moved(view, rng)
    return *view.drawn(box, velocity), misfit_of(box, truth)


def _moved(view: BoxView, rng: np.random.Generator) -> tuple[Box, Float64Array]:
    """A box that is farther off, and a velocity that is."""
    box = view.box
    shift, larger, aspect = rng.uniform(0, (MOVED, RESIZED, STRETCHED))
    right, below, larger, aspect = rng.standard_normal(4) * (shift, shift, larger, aspect)
    width, height = box.w * math.exp(larger + aspect), box.h * math.exp(larger - aspect)
    x, y = box.center[0] + right * box.w, box.center[1] + below * box.h
    speed_px_s = math.hypot(*view.velocity.tolist())
    velocity = view.velocity + VELOCITY_OFF * speed_px_s * rng.standard_normal(2)
    return Box(x - width / 2, y - height / 2, width, height), velocity


def _likelihood(offsets: Tensor, log_spreads: Tensor, misfits: Tensor) -> Tensor:
    return ((misfits - offsets).abs() * torch.exp(-log_spreads) + log_spreads).clamp(max=LOSS_MAX).mean()


def _overlaps(offsets: Tensor, misfits: Tensor) -> Tensor:
    """IoU of boxes put right by `offsets` with the right ones, both in parts of the boxes as they are; shape (n,)."""
    put_right, right = (torch.cat([part[:, :2], torch.exp(part[:, 2:])], 1) for part in (offsets, misfits))
    return intersection_over_union(put_right, right)
