"""Sequences made, and batches cut from them, by other processes while the training goes on."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Generator, Iterable, Iterator
from typing import Any

import cv2
import numpy as np
from torch.utils.data import DataLoader, Dataset

from etd_ros.recovery.training.config import VALIDATION_SEEDS, TrainingConfig
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.recovery.training.lesson import BatchT, Cache, Sampler

WAIT_S = 0.2
TRAINING_STREAM = 5
"""Beside the seed and the step: of no other choice."""
BATCHES_AHEAD = 2
"""Of each process that cuts them; their sequences are waited for as much sooner."""
NICENESS, CUTTING_NICENESS = 10, 5
"""The training goes first where they share a core, then what cuts its batches: it waits for sequences only where it has
none to draw from."""


class SequenceMaker:
    """Processes that simulate the sequences, in the order in which they are needed.

    Args:
        cache: where to.
        config: says which are needed.
        processes: how many.
    """

    def __init__(self, cache: Cache, config: TrainingConfig, processes: int = 1) -> None:
        self._cache, self._config, self._ready = cache, config, 0
        training = range(config.sequences)
        self._validation = range(VALIDATION_SEEDS, VALIDATION_SEEDS + config.validation_sequences)
        seeds = [*self._validation, *training]
        missing = [seed for seed in seeds if not cache.has(seed)]
        # Processes that start afresh: threads of torch and OpenCV do not survive a fork.
        context = multiprocessing.get_context("spawn")
        self._processes = [
            context.Process(target=_make, args=(cache, missing[index::processes]), daemon=True)
            for index in range(min(processes, len(missing)))
        ]
        for process in self._processes:
            process.start()

    def wait_for_validation(self) -> None:
        for seed in self._validation:
            self._wait(seed)

    def wait_for(self, count: int) -> None:
        """Wait until the first `count` sequences are there.

        Raises:
            TrainingError: a process has ended without making its part.
        """
        while self._ready < count:
            self._wait(self._ready)
            self._ready += 1

    def steps(self, first: int, last: int) -> Iterator[int]:
        """The numbers of the steps from `first` to before `last`, each once its sequences are there."""
        for step in range(first, last):
            self.wait_for(self._config.pool(step))
            yield step

    def stop(self) -> None:
        for process in self._processes:
            process.terminate()
        for process in self._processes:
            process.join()

    def _wait(self, seed: int) -> None:
        while not self._cache.has(seed):
            if not self._is_coming():
                if self._cache.has(seed):
                    return
                msg = f"sequence {seed} was not simulated: see the error above, and go on with --resume"
                raise TrainingError(msg)
            time.sleep(WAIT_S)

    def _is_coming(self) -> bool:
        """Whether all processes that have not ended well go on."""
        return any(process.is_alive() for process in self._processes) and not any(
            process.exitcode for process in self._processes
        )


class BatchCutter(Dataset[BatchT | TrainingError]):
    """The batches of a training by the number of their step, each decided by the seed and that number.

    Args:
        sampler: cuts them.
        config: says how large, from which sequences.
    """

    def __init__(self, sampler: Sampler[BatchT], config: TrainingConfig) -> None:
        self._sampler, self._config = sampler, config

    def __getitem__(self, step: int) -> BatchT | TrainingError:
        """The batch, or what went wrong: another process's errors would come as its whole traceback."""
        try:
            return self.batch(step)
        except TrainingError as err:
            return err

    def batch(self, step: int) -> BatchT:
        """The batch of a step.

        Raises:
            TrainingError: a sequence is missing or damaged.
        """
        rng = np.random.default_rng([TRAINING_STREAM, self._config.seed, step])
        return self._sampler.batch(rng, np.arange(self._config.pool(step)), self._config.batch)

    def batches(self, steps: Iterable[int], processes: int) -> Generator[BatchT]:
        """The batches of `steps` in their order, cut ahead by so many processes; by this one where it is one.

        Raises:
            TrainingError: a sequence is missing or damaged.
        """
        if processes == 1:
            yield from map(self.batch, steps)
            return
        loader = DataLoader(
            self,
            batch_size=None,
            sampler=steps,
            num_workers=processes,
            collate_fn=_as_it_is,
            prefetch_factor=BATCHES_AHEAD,
            multiprocessing_context="spawn",
            worker_init_fn=_begin_cutting,
        )
        for batch in loader:
            if isinstance(batch, TrainingError):
                raise batch
            yield batch


def _as_it_is(batch: Any) -> Any:
    return batch


def _begin_cutting(_: int) -> None:
    cv2.setNumThreads(1)
    os.nice(CUTTING_NICENESS)
    # An interrupted training ends its processes itself.
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _make(cache: Cache, seeds: list[int]) -> None:
    os.nice(NICENESS)
    training = os.getppid()
    for seed in seeds:
        # A training that was killed cannot end its processes.
        if os.getppid() != training:
            return
        cache.make(seed)
