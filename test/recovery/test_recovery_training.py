"""A training learns, goes on where it stopped, and refuses what it cannot use."""

from __future__ import annotations

import csv
import dataclasses
import os
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from recovery_trainings import SHORT
from safetensors import safe_open

from etd_ros.output_files import OutputError
from etd_ros.recovery import RecoveryError
from etd_ros.recovery.training import sequences
from etd_ros.recovery.training.compact_lesson import CompactLesson
from etd_ros.recovery.training.config import VALIDATION_SEEDS
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.recovery.training.loop import Progress, Training, prepare
from etd_ros.recovery.training.making import SequenceMaker
from etd_ros.recovery.training.sequences import SequenceCache
from etd_ros.recovery.weights_file import COMPACT, SHIPPED, load_compact, save_compact


@pytest.fixture(autouse=True)
def _one_thread():
    prepare("cpu", 1, 1.0)


@pytest.fixture
def training(sequence_folder, tmp_path):
    def make(name: str = "out", config=SHORT, **options) -> Training:
        cache = SequenceCache(sequence_folder)
        return Training(config, cache, tmp_path / name, make_lesson=CompactLesson, **options)

    return make


def run(training: Training, **options) -> list[Progress]:
    progress: list[Progress] = []
    training.run(progress.append, **options)
    return progress


def test_a_short_training_lowers_the_loss_on_sequences_it_has_not_seen(training):
    progress = run(training(config=dataclasses.replace(SHORT, interval=10)))
    assert [item.step for item in progress] == list(range(1, 61))
    figures = [item.figures for item in progress if item.figures is not None]
    assert len(figures) == 6
    assert progress[-1].loss < 0.7 * progress[0].loss
    assert figures[-1].loss < 0.7 * figures[0].loss


def test_pairs_that_other_processes_cut_teach_the_same(training):
    alone, helped = training("alone"), training("helped", processes=2)
    for each in (alone, helped):
        run(each, until=3)
    for name, value in alone.network.state_dict().items():
        assert torch.equal(value, helped.network.state_dict()[name]), name


@pytest.mark.parametrize("processes", [1, 2])
def test_a_damaged_sequence_is_named_whoever_reads_it(tmp_path, sequence_folder, processes):
    shutil.copytree(sequence_folder, tmp_path / "cache")
    (tmp_path / "cache" / "0000001.images.npy").write_bytes(b"no array")
    cache = SequenceCache(tmp_path / "cache")
    with pytest.raises(TrainingError, match="^[^ ]*0000001.images.npy: sequence 1 is missing or damaged"):
        run(Training(SHORT, cache, tmp_path / "out", make_lesson=CompactLesson, processes=processes), until=3)


def test_only_so_many_sequences_are_kept_open(sequence_folder, monkeypatch):
    monkeypatch.setattr(sequences, "OPEN_MAX", 2)
    cache = SequenceCache(sequence_folder)
    for seed in (0, 1, 2, 0, 1):
        np.testing.assert_array_equal(
            cache.sequence(seed).images, np.load(sequence_folder / f"{seed:07}.images.npy"), strict=True
        )
        assert len(cache._open) <= 2


def test_at_its_end_normalisations_keep_their_statistics(training):
    settling = training(config=dataclasses.replace(SHORT, settled=0.5))
    run(settling, until=31)
    kept = {name: value.clone() for name, value in settling.network.state_dict().items()}
    run(settling, until=35)
    changed = {name for name, value in settling.network.state_dict().items() if not torch.equal(value, kept[name])}
    assert not any("running" in name for name in changed)
    assert any(name.endswith("weight") for name in changed)


def test_shipped_weights_are_trained_further(training):
    further = training()
    further.start_from(SHIPPED)
    shipped = load_compact().state_dict()
    assert all(torch.equal(value, shipped[name]) for name, value in further.network.state_dict().items())
    with pytest.raises(RecoveryError, match="no readable safetensors file"):
        further.start_from(Path("nowhere.safetensors"))


def logged(folder: Path) -> list[dict[str, str]]:
    """What a training's log says, without the time that it took."""
    with (folder / "log.csv").open() as file:
        return [{name: value for name, value in row.items() if name != "seconds"} for row in csv.DictReader(file)]


def test_going_on_from_a_checkpoint_is_the_same_as_not_stopping(training, tmp_path):
    straight = training("straight")
    run(straight, until=40)
    run(training("stopped"), until=30)
    resumed = training("stopped")
    resumed.resume()
    assert resumed.step == 30
    run(resumed, until=40)
    for name, value in straight.network.state_dict().items():
        assert torch.equal(value, resumed.network.state_dict()[name]), name
    assert logged(tmp_path / "straight") == logged(tmp_path / "stopped")
    straight_file, resumed_file = (tmp_path / name / "compact.safetensors" for name in ("straight", "stopped"))
    assert straight_file.read_bytes() == resumed_file.read_bytes()


def test_a_checkpoint_of_before_losses_were_kept_can_be_gone_on_from(training, tmp_path):
    run(training(), until=30)
    path = tmp_path / "out" / "checkpoint.pt"
    saved = torch.load(path, weights_only=True)
    del saved["losses_lately"]
    torch.save(saved, path)
    resumed = training()
    resumed.resume()
    assert [item.step for item in run(resumed, until=31)] == [31]


def test_equal_weights_are_equal_files_whatever_is_said_of_them(tmp_path):
    about = {str(number): "\u00e9" * number for number in range(20)}
    files = [tmp_path / str(number) for number in range(3)]
    for file in files:
        save_compact(load_compact(), file, about)
    assert len({file.read_bytes() for file in files}) == 1
    load_compact(files[0])
    with safe_open(files[0], framework="pt") as file:
        assert file.metadata() == {"network": COMPACT, **about}


def test_log_and_weights_are_left_behind(training, tmp_path):
    run(training(), until=30)
    with (tmp_path / "out" / "log.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["step"] for row in rows] == ["30"]
    assert 0 < float(rows[0]["validation_loss"]) < 100
    load_compact(tmp_path / "out" / "compact.safetensors")
    assert not list((tmp_path / "out").glob(".*"))


def test_the_step_size_rises_then_falls_with_the_time_that_is_left(training):
    sizes = []
    watched = training(minutes=1e9)
    watched.run(lambda _: sizes.append(watched._optimiser.param_groups[0]["lr"]))
    top = int(np.argmax(sizes))
    assert 3 <= top <= 8
    assert sizes[-1] < 0.05 * sizes[top]


def test_a_training_ends_when_its_time_is_over(training, tmp_path):
    progress = run(training(minutes=1e-9))
    assert [item.step for item in progress] == [1]
    assert (tmp_path / "out" / "compact.safetensors").is_file()


def test_missing_damaged_and_other_checkpoints_are_refused(training, tmp_path):
    with pytest.raises(TrainingError, match="no checkpoint to go on from"):
        training("none").resume()
    run(training(), until=1)
    with pytest.raises(TrainingError, match="was made with another batch, seed"):
        training(config=dataclasses.replace(SHORT, batch=5, seed=9)).resume()
    path = tmp_path / "out" / "checkpoint.pt"
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(TrainingError) as refused:
        training().resume()
    assert str(refused.value) == (
        f"{path}: no checkpoint to go on from (it is damaged, or holds more than weights): train without --resume"
    )


class _Evil:
    def __init__(self, trace) -> None:
        self._trace = trace

    def __reduce__(self):
        return os.mkdir, (str(self._trace),)


def test_code_in_a_checkpoint_is_not_run(training, tmp_path):
    evil = training()
    trace = tmp_path / "was_run"
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "checkpoint.pt").write_bytes(pickle.dumps(_Evil(trace), protocol=2))
    with pytest.raises(TrainingError, match="no checkpoint"):
        evil.resume()
    assert not trace.exists()


def test_sequences_are_made_beside_the_training(tmp_path):
    cache = SequenceCache(tmp_path)
    config = dataclasses.replace(SHORT, sequences=1, first_sequences=1)
    maker = SequenceMaker(cache, config)
    try:
        maker.wait_for_validation()
        maker.wait_for(1)
    finally:
        maker.stop()
    assert cache.has(0)
    assert len(cache.sequence(VALIDATION_SEEDS).images) > 50


def test_a_maker_that_fails_is_noticed(tmp_path):
    cache = SequenceCache(tmp_path / "cache")
    maker = SequenceMaker(cache, dataclasses.replace(SHORT, sequences=1, first_sequences=1))
    maker.stop()
    with pytest.raises(TrainingError, match="was not simulated"):
        maker.wait_for_validation()


def test_impossible_devices_threads_and_times_are_refused():
    if not torch.cuda.is_available():
        with pytest.raises(TrainingError, match="torch finds no CUDA"):
            prepare("cuda", 1, 1.0)
    for threads, minutes, processes in ((0, 1.0, 1), (1, 0.0, 1), (1, float("nan"), 1), (1, 1.0, 0), (1, 1.0, 9999)):
        with pytest.raises(TrainingError, match="threads and"):
            prepare("cpu", threads, minutes, processes)


def test_folders_that_cannot_be_made_are_named(tmp_path, sequence_folder):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file is no folder"):
        SequenceCache(tmp_path / "file" / "cache").make(0)
    with pytest.raises(OutputError, match="file is no folder"):
        run(Training(SHORT, SequenceCache(sequence_folder), tmp_path / "file" / "out", make_lesson=CompactLesson))
