"""The training: steps on batches, a figure now and then, and checkpoints to go on from."""

from __future__ import annotations

import csv
import dataclasses
import math
import pickle
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import cv2
import numpy as np
import torch

from etd_ros.output_files import make_folder
from etd_ros.recovery.training.config import VALIDATION_SEEDS, TrainingConfig
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.recovery.training.lesson import BatchT, Cache, Figures, Lesson, TensorsT
from etd_ros.recovery.training.making import BatchCutter, SequenceMaker
from etd_ros.recovery.weights_file import load_pickle

CHECKPOINT_NAME, LOG_NAME = "checkpoint.pt", "log.csv"
VALIDATION_STREAM = 6
GRADIENT_MAX = 5.0
THREADS_MAX = 1024
AVERAGED_STEPS = 50

CacheT = TypeVar("CacheT", bound=Cache)


def prepare(device: str, threads: int, minutes: float, processes: int = 1) -> None:
    """Check what the training is to run on, and give torch and OpenCV their threads.

    Raises:
        TrainingError: no such device here, or an impossible number of threads, processes or minutes.
    """
    if device == "cuda" and not torch.cuda.is_available():
        msg = "device 'cuda': torch finds no CUDA here; install a CUDA build of torch, or train with --device cpu"
        raise TrainingError(msg)
    if not 1 <= min(threads, processes) <= max(threads, processes) <= THREADS_MAX or not minutes > 0:
        msg = (
            f"{threads} threads and {processes} processes for {minutes:g} minutes: give 1 to {THREADS_MAX} of each and "
            "more than 0 minutes"
        )
        raise TrainingError(msg)
    torch.set_num_threads(threads)
    torch.backends.cudnn.benchmark = torch.backends.cudnn.allow_tf32 = torch.backends.cuda.matmul.allow_tf32 = True
    cv2.setNumThreads(threads)


class Progress(NamedTuple):
    """What a watcher is told after a step: steps done, the share of the training, the loss lately, figures if new."""

    step: int
    share: float
    loss: float
    figures: Figures | None


class Training(Generic[BatchT, TensorsT]):
    """A training that can stop after any step and go on from its checkpoint as if it had not.

    Every batch follows from the seed and the step's number, and so does the step size unless `minutes` limits it.

    Args:
        config: what is trained.
        cache: keeps the sequences.
        output: folder of checkpoint, log and weights; made once there is something to train.
        make_lesson: of the cache and the device, what is trained, from random weights.
        device: where it runs.
        minutes: the step size falls so that it ends after this time, or the steps, whichever comes first.
        processes: that make sequences; from 2 on as many others cut the batches, which a GPU waits for otherwise.
            The weights do not depend on it.
    """

    def __init__(
        self,
        config: TrainingConfig,
        cache: CacheT,
        output: Path,
        *,
        make_lesson: Callable[[CacheT, torch.device], Lesson[BatchT, TensorsT]],
        device: str = "cpu",
        minutes: float = math.inf,
        processes: int = 1,
    ) -> None:
        self._config, self._cache, self._output, self._processes = config, cache, output, processes
        self._device, self._limit_s = torch.device(device), 60 * minutes
        torch.manual_seed(config.seed)
        self._lesson = make_lesson(cache, self._device)
        self.network = self._lesson.network
        self._optimiser = torch.optim.AdamW(
            self.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        self.step, self._before_s = 0, 0.0
        self._lately: list[tuple[float, ...]] = []

    def check_is_new(self) -> None:
        """Refuse an output folder that holds a training, which this one would overwrite.

        Raises:
            TrainingError: it does.
        """
        found = [name for name in (CHECKPOINT_NAME, LOG_NAME, self._lesson.weights_name) if self._has(name)]
        if found:
            cure = "go on with --resume, or " if self._has(CHECKPOINT_NAME) else ""
            msg = f"{self._output}: holds a training ({', '.join(found)}) already: {cure}name another folder"
            raise TrainingError(msg)

    def _has(self, name: str) -> bool:
        return (self._output / name).exists()

    def start_from(self, path: Path) -> None:
        """Train the weights of a file further.

        Raises:
            RecoveryError: no readable weights of this network.
        """
        self._lesson.load(path)

    def resume(self) -> None:
        """Go on from the checkpoint in the output folder.

        Raises:
            TrainingError: there is none, or it is damaged or of another configuration.
            RecoveryError: this torch is no protection from code in it.
        """
        path = self._output / CHECKPOINT_NAME
        try:
            saved: dict[str, Any] = load_pickle(path, self._device)
            same = {name: value for name, value in saved["config"].items() if name != "steps"}
            wanted = {name: value for name, value in self._described().items() if name != "steps"}
            if same != wanted:
                names = ", ".join(sorted(name for name in wanted if same.get(name) != wanted[name]))
                msg = f"{path}: was made with another {names}: give the same, or start anew in another folder"
                raise TrainingError(msg)
            self.network.load_state_dict(saved["network"])
            self._optimiser.load_state_dict(saved["optimiser"])
            self.step, self._before_s = int(saved["step"]), float(saved["seconds"])
            # Checkpoints of before do not have it.
            self._lately = [tuple(map(float, losses)) for losses in saved.get("losses_lately", ())]
        except (RuntimeError, ValueError, KeyError, TypeError, AttributeError, pickle.UnpicklingError) as err:
            msg = f"{path}: no checkpoint to go on from ({' '.join(str(err).split())[:80]}): train without --resume"
            raise TrainingError(msg) from err

    def run(self, watch: Callable[[Progress], None], *, until: int | None = None) -> None:
        """Train to the end, or to step `until`; checkpoint, log and weights are written at intervals and at the end.

        Raises:
            OutputError: the output folder cannot be made.
            TrainingError: files cannot be written, or the loss is not finite.
        """
        make_folder(self._output)
        config = self._config
        last = min(config.steps, config.steps if until is None else until)
        maker = SequenceMaker(self._cache, config, self._processes)
        started = time.monotonic() - self._before_s
        try:
            validation = self._validation(maker)
            cutter = BatchCutter(self._lesson.sampler, config)
            with closing(cutter.batches(maker.steps(self.step, last), self._processes)) as batches:
                for batch in batches:
                    share = max(self.step / config.steps, (time.monotonic() - started) / self._limit_s)
                    losses = self._take_step(batch, share)
                    self._lately = [*self._lately[1 - AVERAGED_STEPS :], losses]
                    self.step += 1
                    is_over = self.step == last or time.monotonic() - started >= self._limit_s
                    figures = None
                    if is_over or self.step % config.interval == 0:
                        figures = self._lesson.validate(validation)
                        self._save(time.monotonic() - started, figures)
                    watch(Progress(self.step, share, sum(np.mean(self._lately, 0).tolist()), figures))
                    if is_over:
                        break
        finally:
            maker.stop()

    def _take_step(self, batch: BatchT, share: float) -> tuple[float, ...]:
        if self._config.settled > 0 and share >= 1 - self._config.settled:
            for module in self.network.modules():
                if isinstance(module, torch.nn.BatchNorm2d):
                    module.eval()
        for group in self._optimiser.param_groups:
            group["lr"] = self._learning_rate(share)
        losses = self._lesson.losses(self._lesson.tensors(batch))
        if not bool(torch.isfinite(losses.total)):
            msg = f"the loss is not finite at step {self.step}: train anew with a smaller learning_rate"
            raise TrainingError(msg)
        self._optimiser.zero_grad(set_to_none=True)
        losses.total.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), GRADIENT_MAX)
        self._optimiser.step()
        return tuple(float(part.detach()) for part in losses)

    def _learning_rate(self, share: float) -> float:
        rising = min(1.0, (self.step + 1) / (self._config.warm_up_steps + 1))
        return self._config.learning_rate * rising * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(share, 1.0))))

    def _validation(self, maker: SequenceMaker) -> list[TensorsT]:
        config = self._config
        maker.wait_for_validation()
        seeds = VALIDATION_SEEDS + np.arange(config.validation_sequences)
        rngs = [np.random.default_rng([VALIDATION_STREAM, number]) for number in range(config.validation_batches)]
        return [self._lesson.tensors(self._lesson.sampler.batch(rng, seeds, config.batch)) for rng in rngs]

    def _described(self) -> dict[str, Any]:
        """What a checkpoint must have been made with to go on from it."""
        return {"network": self._lesson.name, **dataclasses.asdict(self._config)}

    def _save(self, seconds: float, figures: Figures) -> None:
        state = {
            "network": self.network.state_dict(),
            "optimiser": self._optimiser.state_dict(),
            "step": self.step,
            "seconds": seconds,
            "losses_lately": self._lately,
            "config": self._described(),
        }
        try:
            partial = self._output / f".{CHECKPOINT_NAME}"
            torch.save(state, partial)
            partial.replace(self._output / CHECKPOINT_NAME)
            shown = {name: f"{value:.4f}" for name, value in figures._asdict().items()}
            weights_name = self._lesson.weights_name
            partial = self._output / f".{weights_name}"
            self._lesson.save(partial, {"steps": str(self.step), "seed": str(self._config.seed), **shown})
            partial.replace(self._output / weights_name)
            self._log(seconds, figures)
        except OSError as err:
            msg = f"{self._output}: cannot be written ({err.strerror or err}): make room or name another folder"
            raise TrainingError(msg) from err

    def _log(self, seconds: float, figures: Figures) -> None:
        path = self._output / LOG_NAME
        is_new = not path.is_file()
        rate = self._optimiser.param_groups[0]["lr"]
        numbers = (seconds, rate, *np.mean(self._lately, 0).tolist(), *figures)
        with path.open("a", newline="") as file:
            writer = csv.writer(file)
            if is_new:
                columns = (*self._lesson.loss_names, *(f"validation_{name}" for name in figures._fields))
                writer.writerow(("step", "seconds", "learning_rate", *columns))
            writer.writerow((self.step, *(f"{number:.6g}" for number in numbers)))
