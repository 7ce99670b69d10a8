"""One cell: from a recording to its result, and what goes wrong on the way."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from evaluation_sequences import DURATION_S, tasks_of, write_sequence

from etd_ros.boxes import Box
from etd_ros.datasets import LabelledSequence
from etd_ros.evaluation import TimedBox, TrackRow, score
from etd_ros.evaluation.cell_run import CellTask, Workplace, run_cell
from etd_ros.evaluation.cells import Cell
from etd_ros.recordings import open_recording
from etd_ros.systems.running import run_system
from etd_ros.targets import TargetStart


@pytest.fixture(scope="module")
def square(tmp_path_factory):
    return write_sequence(tmp_path_factory.mktemp("sequences"))


def test_a_one_pass_cell_has_the_figures_of_the_systems_own_track(square):
    (task,) = tasks_of(square, systems=("kcf",))
    result = run_cell(task, Workplace())
    labels = square.boxes["square"]
    with open_recording(square.recording) as recording:
        rows = [
            TrackRow(step.stamp_ns, "square", report.box, report.score, report.state.value)
            for step in run_system("kcf", recording, [TargetStart("square", labels[0].box, labels[0].stamp_ns)])
            for report in step.reports
        ]
        events = sum(
            labels[0].stamp_ns <= stamp_ns <= labels[-1].stamp_ns
            for batch in recording.events()
            for stamp_ns in batch.t.tolist()
        )
    expected = score({"square": rows}, {"square": labels})["square"]
    assert (result.ap, result.ar, len(result.overlaps)) == (expected.ap, expected.ar, expected.n)
    assert [row for row in rows if row.state != "idle" and row.stamp_ns <= labels[-1].stamp_ns] == result.track
    assert result.error is None
    assert (result.frames, result.events) == (len(result.track), events)
    assert result.seconds > 0


def test_a_system_that_fails_scores_more_when_it_is_started_again(square):
    one_pass, restarts = (run_cell(task, Workplace()) for task in tasks_of(square, protocols=("one-pass", "restarts")))
    assert (one_pass.failures, one_pass.ar < 0.9) == (0, True)
    assert restarts.failures > 0
    assert restarts.ap > one_pass.ap
    assert len(restarts.overlaps) == len(one_pass.overlaps) - restarts.failures


def test_labels_after_the_recordings_end_are_failures_and_nothing_more(square):
    labels = square.boxes["square"]
    late = [TimedBox(round((DURATION_S + 5 + number) * 1e9), Box(1, 1, 5, 5)) for number in range(4)]
    longer = dataclasses.replace(square, boxes={"square": [*labels, *late]})
    (task,) = tasks_of(longer, systems=("etd-plus",), protocols=("restarts",))
    result = run_cell(task, Workplace())
    assert result.error is None
    assert result.overlaps[-3:] == [0, 1, 1]


def test_only_systems_with_randomness_are_repeated(square):
    tasks = tasks_of(square, systems=("kcf", "tld"), repetitions=3)
    assert [(task.cell.system, task.cell.repetition) for task in tasks] == [
        ("kcf", 0), ("tld", 0), ("tld", 1), ("tld", 2)
    ]  # fmt: skip
    assert tasks[0].cell == Cell("folder", "square", "square", "kcf", "one-pass", 0)


def test_the_repetition_seeds_what_is_random(square):
    first, again, other = (
        run_cell(task, Workplace())
        for task in [*tasks_of(square, systems=("tld",)), *tasks_of(square, systems=("tld",), repetitions=2)]
    )
    assert first.track == again.track
    assert first.track != other.track


def gone(task: CellTask, folder: Path) -> CellTask:
    return dataclasses.replace(task, recording=folder / "gone")


def damaged(task: CellTask, folder: Path) -> CellTask:
    (folder / "events.txt").write_text("0.1 5 5 1\n0.2 5 5\n")
    return dataclasses.replace(task, recording=folder)


def without_video(task: CellTask, folder: Path) -> CellTask:
    sequence = write_sequence(folder, video=False)
    return dataclasses.replace(task, recording=sequence.recording, cell=dataclasses.replace(task.cell, system="kcf"))


def labelled_once(task: CellTask, folder: Path) -> CellTask:
    return dataclasses.replace(task, labels=task.labels[:1])


def off_the_sensor(task: CellTask, folder: Path) -> CellTask:
    return dataclasses.replace(
        task, labels=(dataclasses.replace(task.labels[0], box=Box(900, 900, 9, 9)), *task.labels)
    )


def faulty(task: CellTask, folder: Path) -> CellTask:
    return dataclasses.replace(task, labels=(task.labels[0], None, task.labels[-1]))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (gone, "no such file"),
        (damaged, "line 2"),
        (without_video, "'kcf' needs video"),
        (labelled_once, "has 1 labels"),
        (off_the_sensor, "off the 100x80 sensor"),
        (faulty, "AttributeError: 'NoneType'"),
    ],
)
def test_what_goes_wrong_in_a_cell_is_its_result_in_one_line(square, tmp_path, make, message):
    (task,) = tasks_of(square)
    result = run_cell(make(task, tmp_path), Workplace())
    assert message in result.error
    assert "\n" not in result.error
    assert math.isnan(result.ap)
    assert (result.overlaps, result.track) == ((), ())


def test_a_damaged_recording_is_read_once_for_all_of_its_cells(square, tmp_path, monkeypatch):
    task = damaged(tasks_of(square)[0], tmp_path)
    workplace = Workplace()
    first = run_cell(task, workplace)
    monkeypatch.setattr("etd_ros.evaluation.cell_run.open_recording", None)
    assert run_cell(task, workplace).error == first.error
    assert "line 2" in first.error


@pytest.fixture(scope="module")
def resting(tmp_path_factory) -> LabelledSequence:
    """The square, then two seconds without an event, in which it is labelled all the time, then its way back."""
    folder = tmp_path_factory.mktemp("resting")
    sequence = write_sequence(folder)
    there = (folder / "square" / "events.txt").read_text().splitlines()
    back = [line.split() for line in reversed(there)]
    way_back = [f"{3.0 - float(t):.9f} {x} {y} {1 - int(p)}" for t, x, y, p in back]
    (folder / "square" / "events.txt").write_text("\n".join([*there, *way_back]) + "\n")
    labels = list(sequence.boxes["square"])
    rest = [TimedBox(round(time_s * 1e9), labels[-1].box) for time_s in np.arange(0.5, 2.5, 0.1)]
    # The square is said to have been elsewhere for a moment, so that every system fails in the middle of the rest.
    rest[12] = TimedBox(rest[12].stamp_ns, Box(2, 2, 9, 9))
    mirrored = [TimedBox(3 * 10**9 - label.stamp_ns, label.box) for label in reversed(labels)]
    return dataclasses.replace(sequence, boxes={"square": [*labels, *rest, *mirrored]})


@pytest.mark.parametrize("system", ["etd-plus", "etd-nr", "e-ms", "kcf", "kcf-reconstruction", "dasiamrpn-e"])
def test_a_system_starts_again_while_the_scene_rests(resting, system):
    (task,) = tasks_of(resting, systems=(system,), protocols=("restarts",))
    result = run_cell(task, Workplace())
    assert result.error is None
    assert result.failures >= 1
    assert max(result.stamps_ns) > 2_500_000_000
