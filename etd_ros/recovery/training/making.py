"""Sequences made by a process of their own while the training goes on."""

from __future__ import annotations

import multiprocessing
import os
import time
from pathlib import Path
from typing import Any

from etd_ros.recovery.training.config import TrainingConfig
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.recovery.training.sequences import VALIDATION_SEEDS, Pictures, SequenceCache

WAIT_S = 0.2
NICENESS = 10
"""The training goes first where they share a core: it waits for sequences only where it has none to draw from."""


class SequenceMaker:
    """A process that simulates the sequences, in the order in which they are needed."""

    def __init__(self, cache: SequenceCache, config: TrainingConfig) -> None:
        self._cache, self._ready = cache, 0
        training = range(config.sequences)
        self._validation = range(VALIDATION_SEEDS, VALIDATION_SEEDS + config.validation_sequences)
        seeds = [*self._validation, *training]
        self._process: Any = None
        if missing := [seed for seed in seeds if not cache.has(seed)]:
            # A process that starts afresh: threads of torch and OpenCV do not survive a fork.
            context = multiprocessing.get_context("spawn")
            self._process = context.Process(target=_make, args=(cache.folder, cache.pictures, missing), daemon=True)
            self._process.start()

    def wait_for_validation(self) -> None:
        for seed in self._validation:
            self._wait(seed)

    def wait_for(self, count: int) -> None:
        """Wait until the first `count` sequences are there.

        Raises:
            TrainingError: the process has ended without making them.
        """
        while self._ready < count:
            self._wait(self._ready)
            self._ready += 1

    def stop(self) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.join()

    def _wait(self, seed: int) -> None:
        while not self._cache.has(seed):
            if self._process is None or not self._process.is_alive():
                if self._cache.has(seed):
                    return
                msg = f"sequence {seed} was not simulated: see the error above, and go on with --resume"
                raise TrainingError(msg)
            time.sleep(WAIT_S)


def _make(folder: Path, pictures: Pictures, seeds: list[int]) -> None:
    os.nice(NICENESS)
    training = os.getppid()
    cache = SequenceCache(folder, pictures)
    for seed in seeds:
        # A training that was killed cannot end its processes.
        if os.getppid() != training:
            return
        cache.make(seed)
