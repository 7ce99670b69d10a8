"""What the tests of training share: sequences, simulated once."""

from __future__ import annotations

from pathlib import Path

import pytest
from recovery_boxes import BOX_SEEDS
from recovery_trainings import SHORT

from etd_ros.recovery.training.box_samples import SampleCache
from etd_ros.recovery.training.config import VALIDATION_SEEDS
from etd_ros.recovery.training.sequences import SequenceCache


@pytest.fixture(scope="session")
def sequence_folder(tmp_path_factory) -> Path:
    """A cache that holds all that SHORT needs."""
    folder = tmp_path_factory.mktemp("sequences")
    cache = SequenceCache(folder)
    for seed in (*range(SHORT.sequences), VALIDATION_SEEDS):
        cache.make(seed)
    return folder


@pytest.fixture(scope="session")
def box_folder(tmp_path_factory) -> Path:
    """A cache of views along the tracks of two scenes that are simulated fast: of one target, and of two."""
    folder = tmp_path_factory.mktemp("boxes")
    cache = SampleCache(folder)
    for seed in BOX_SEEDS:
        cache.make(seed)
    return folder
