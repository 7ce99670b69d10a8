"""The training asks nothing of a lesson but what its protocols say: here a straight line is fitted to points."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from recovery_trainings import SHORT
from safetensors.torch import load_file, save_file

from etd_ros.recovery.training.loop import Progress, Training, prepare

CONFIG = dataclasses.replace(SHORT, batch=8, learning_rate=0.3, weight_decay=0.0)
SLOPE, HEIGHT = 3.0, -1.0


@dataclasses.dataclass(frozen=True)
class Places:
    """A cache: where round the points of a sequence are, one number in a file."""

    folder: Path

    def has(self, seed: int) -> bool:
        return self._path(seed).is_file()

    def make(self, seed: int) -> None:
        partial = self._path(seed).with_suffix(".part")
        partial.write_text(f"{np.random.default_rng(seed).normal()}")
        partial.replace(self._path(seed))

    def place(self, seed: int) -> float:
        return float(self._path(seed).read_text())

    def _path(self, seed: int) -> Path:
        return self.folder / f"{seed}.txt"


@dataclasses.dataclass(frozen=True)
class Points:
    """A sampler: points on the line, an array of shape (count, 2)."""

    places: Places

    def batch(self, rng, seeds, count):
        x = [self.places.place(seed) + rng.normal() for seed in rng.choice(seeds, count)]
        return np.stack([x, SLOPE * np.array(x) + HEIGHT], 1)


class Loss(NamedTuple):
    error: torch.Tensor

    @property
    def total(self):
        return self.error


class Figures(NamedTuple):
    loss: float

    def told(self):
        return f"error {self.loss:.3f}"


class LineLesson:
    """Its batches and tensors are neither pairs nor named tuples."""

    name = "line"
    weights_name = "line.safetensors"
    loss_names = Loss._fields

    def __init__(self, cache, device) -> None:
        self.network, self.sampler = torch.nn.Linear(1, 1).to(device), Points(cache)
        self._device = device

    def tensors(self, batch):
        return torch.tensor(batch, dtype=torch.float32, device=self._device)

    def losses(self, batch):
        x, y = batch.split(1, 1)
        return Loss((self.network(x) - y).square().mean())

    def validate(self, batches):
        with torch.inference_mode():
            return Figures(float(np.mean([float(self.losses(batch).total) for batch in batches])))

    def load(self, path):
        self.network.load_state_dict(load_file(path))

    def save(self, path, about):
        save_file(self.network.state_dict(), path, dict(about))


def run(training: Training, **options) -> list[Progress]:
    progress: list[Progress] = []
    training.run(progress.append, **options)
    return progress


def test_a_lesson_of_another_kind_is_learnt_and_gone_on_with_as_if_it_had_not_stopped(tmp_path):
    prepare("cpu", 1, 1.0)

    def training(name: str, **options) -> Training:
        return Training(CONFIG, Places(tmp_path), tmp_path / name, make_lesson=LineLesson, **options)

    straight = training("straight", processes=2)
    progress = run(straight)
    assert progress[-1].figures.loss < 0.05 * progress[0].loss
    run(training("stopped"), until=30)
    resumed = training("stopped")
    resumed.resume()
    assert resumed.step == 30
    run(resumed)
    further = training("further")
    further.start_from(tmp_path / "stopped" / "line.safetensors")
    for network in (resumed.network, further.network):
        for name, value in straight.network.state_dict().items():
            assert torch.equal(value, network.state_dict()[name]), name
    assert (tmp_path / "stopped" / "log.csv").read_text().splitlines()[0] == (
        "step,seconds,learning_rate,error,validation_loss"
    )
