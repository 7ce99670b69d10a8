"""The protocols: one pass against the reference script, re-starts against a plain reading of their rules."""

from __future__ import annotations

import json
import math
import random
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from etd_ros.boxes import Box
from etd_ros.engine import track
from etd_ros.evaluation import EvaluationError, TimedBox, TracksWriter, read_boxes, write_boxes
from etd_ros.evaluation.protocol import STARTED, WARM_UP_NS, centre_error_px, one_pass, restarts
from etd_ros.evaluation.scoring import score_of
from etd_ros.recordings import open_recording
from etd_ros.targets import TargetStart
from etd_ros.tracking import TargetReport, TargetState

BOX = Box(10, 10, 20, 10)
HALF, THIRD = Box(10, 10, 10, 10), Box(20, 10, 20, 10)
AWAY = Box(100, 100, 5, 5)


@dataclass(frozen=True)
class Said:
    stamp_ns: int
    reports: tuple[TargetReport, ...]
    seconds: float = 0.5


def said(stamp_ns: int, box: Box | None) -> Said:
    state = TargetState.TRACKING if box else TargetState.LOST
    return Said(stamp_ns, (TargetReport("a", state, box, 1.0),))


class Scripted:
    """A system that says, after each start, what is written for it."""

    def __init__(self, *runs: Sequence[Said]) -> None:
        self._runs = iter(runs)
        self.starts: list[tuple[int, Box, int | None]] = []
        self.given: list[int] = []

    def __call__(self, start: TargetStart, from_ns: int | None) -> Iterator[Said]:
        self.starts.append((start.stamp_ns, start.box, from_ns))
        for step in next(self._runs):
            self.given.append(step.stamp_ns)
            yield step


def labels(*stamps_ns: int) -> list[TimedBox]:
    return [TimedBox(stamp_ns, BOX) for stamp_ns in stamps_ns]


def reference(script: Path, tracks: Path, boxes: Path) -> dict[str, dict[str, float]]:
    """What the reference script says of each target."""
    command = [sys.executable, str(script), str(tracks), str(boxes), "--json"]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return json.loads(output)["targets"]


def near(rng: random.Random) -> Box:
    return Box(rng.uniform(0, 9), rng.uniform(0, 9), rng.uniform(5, 30), rng.uniform(5, 30))


@pytest.mark.parametrize("seed", range(4))
def test_one_pass_gives_the_reference_scripts_figures_to_the_last_bit(data, tmp_path, seed):
    rng = random.Random(seed)
    stamps_ns = sorted(rng.randrange(1_000_000) for _ in range(300))
    steps = [said(stamp_ns, None if rng.random() < 0.2 else near(rng)) for stamp_ns in stamps_ns]
    truth = [
        TimedBox(stamp_ns, Box(*(round(value, 3) for value in near(rng)))) for stamp_ns in range(0, 1_100_000, 7000)
    ]
    outcome = one_pass(Scripted(steps), "a", truth)
    with TracksWriter(tmp_path / "tracks.csv") as writer:
        for step in steps:
            writer.write_reports(step.stamp_ns, step.reports)
    write_boxes(tmp_path / "boxes.csv", {"a": truth})
    expected = reference(data.parent / "tools" / "score.py", tmp_path / "tracks.csv", tmp_path / "boxes.csv")["a"]
    found = score_of(outcome.overlaps)
    assert (found.ap, found.ar, found.n) == (expected["AP"], expected["AR"], expected["n"])


def test_one_pass_gives_the_reference_scripts_figures_on_a_real_recording(data, tmp_path):
    boxes = data / "traffic" / "boxes.csv"
    truth = read_boxes(boxes)["silver_car"]

    start = TargetStart("silver_car", truth[0].box, truth[0].stamp_ns)
    with open_recording(data / "traffic" / "traffic.mcap") as recording:
        steps = [
            Said(step.frame.stamp_ns, step.reports)
            for step in track(recording.streams(), [start], method="etd-nr", threads=False)
        ]
    with TracksWriter(tmp_path / "tracks.csv") as writer:
        for step in steps:
            writer.write_reports(step.stamp_ns, step.reports)
    system = Scripted(steps)
    outcome = one_pass(system, "silver_car", truth)
    assert system.starts == [(start.stamp_ns, start.box, None)]
    expected = reference(data.parent / "tools" / "score.py", tmp_path / "tracks.csv", boxes)["silver_car"]
    found = score_of(outcome.overlaps)
    assert (found.ap, found.ar, found.n) == (expected["AP"], expected["AR"], expected["n"])
    assert 0 < found.ap < 1


def test_one_pass_counts_the_answers_from_the_start_to_the_last_label():
    idle = Said(0, (TargetReport("a", TargetState.IDLE, None, 0.0),))
    system = Scripted([idle, said(1, BOX), said(2, None), said(4, THIRD), said(5, BOX)])
    outcome = one_pass(system, "a", labels(1, 2, 3, 4))
    assert system.starts == [(1, BOX, None)]
    assert [row.stamp_ns for row in outcome.track] == [1, 2, 4]
    assert (outcome.frames, outcome.seconds, outcome.failures) == (3, 1.5, 0)
    assert outcome.stamps_ns == [2, 3, 4]
    assert outcome.overlaps == [0, 0, 1 / 3]
    assert outcome.centre_errors_px == [math.inf, math.inf, 10.0]


def test_a_label_that_fails_counts_and_the_system_starts_again_at_the_next_one_which_does_not_count():
    first = [said(1, BOX), said(2, BOX), said(3, AWAY), said(4, BOX), said(9, BOX)]
    second = [said(5, HALF), said(6, HALF), said(7, HALF)]
    system = Scripted(first, second)
    outcome = restarts(system, "a", labels(1, 2, 3, 5, 6, 7))
    assert system.starts == [(1, BOX, None), (5, BOX, 0)]
    assert outcome.stamps_ns == [2, 3, 6, 7]
    assert outcome.overlaps == [1, 0, 0.5, 0.5]
    assert outcome.failures == 1
    assert [(row.stamp_ns, row.state) for row in outcome.track] == [
        (1, STARTED), (1, "tracking"), (2, "tracking"), (3, "tracking"),
        (5, STARTED), (5, "tracking"), (6, "tracking"), (7, "tracking"),
    ]  # fmt: skip
    assert (outcome.frames, outcome.seconds) == (6, 3.0)


def test_a_system_that_failed_is_given_nothing_more():
    system = Scripted([said(1, BOX), said(2, AWAY), *(said(stamp_ns, BOX) for stamp_ns in range(3, 99))], [])
    restarts(system, "a", labels(1, 2, 3))
    assert system.given == [1, 2, 3]


def test_an_overlap_of_one_half_is_no_failure_and_less_is():
    outcome = restarts(Scripted([said(2, HALF), said(3, THIRD)], []), "a", labels(1, 2, 3, 4))
    assert (outcome.overlaps, outcome.failures) == ([0.5, 1 / 3], 1)


def test_until_its_first_answer_a_system_says_the_box_that_it_started_from():
    outcome = restarts(Scripted([said(4, HALF)]), "a", labels(1, 2, 3, 4))
    assert outcome.overlaps == [1, 1, 0.5]


def test_a_system_that_says_nothing_of_a_target_that_moves_on_is_started_again_and_again():
    truth = [TimedBox(stamp_ns, Box(10 * stamp_ns, 0, 10, 10)) for stamp_ns in range(1, 8)]
    system = Scripted([], [], [], [])
    outcome = restarts(system, "a", truth)
    assert [start[0] for start in system.starts] == [1, 3, 5]
    assert outcome.overlaps == [0, 0, 0]
    assert outcome.failures == 3


def test_a_re_start_is_given_a_second_of_the_recording_before_it():
    truth = [TimedBox(second * WARM_UP_NS, BOX) for second in range(5, 9)]
    system = Scripted([said(6 * WARM_UP_NS, AWAY)], [])
    restarts(system, "a", truth)
    assert system.starts == [(5 * WARM_UP_NS, BOX, None), (7 * WARM_UP_NS, BOX, 6 * WARM_UP_NS)]


def literal_restarts(answers: dict[int, Box | None], truth: list[TimedBox]) -> tuple[list[float], list[int]]:
    """The rules once more, a label after the other, for a system that says the same however it was started.

    Returns:
        (overlaps of the labels scored, indices of the labels that it was started from).
    """
    overlaps, starts, box = [], [0], truth[0].box
    previous = truth[0]
    is_start = False
    for index, label in enumerate(truth[1:], 1):
        if is_start:
            box, is_start = label.box, False
            starts.append(index)
        else:
            for stamp_ns in sorted(answers):
                if previous.stamp_ns <= stamp_ns <= label.stamp_ns:
                    box = answers[stamp_ns]
            overlaps.append(0.0 if box is None else box.iou(label.box))
            is_start = overlaps[-1] < 0.5
        previous = label
    return overlaps, starts


@pytest.mark.parametrize("seed", range(20))
def test_restarts_follow_their_rules_on_random_answers(seed):
    rng = random.Random(seed)
    truth = [TimedBox(stamp_ns, near(rng)) for stamp_ns in range(0, 400, rng.choice((3, 10, 40)))]
    answers: dict[int, Box | None] = {}
    for stamp_ns in sorted(rng.sample(range(400), rng.choice((5, 60, 200)))):
        label = truth[min(len(truth) - 1, stamp_ns * len(truth) // 400)]
        answers[stamp_ns] = rng.choice((None, near(rng), label.box, label.box))
    found_starts = []

    def system(start: TargetStart, from_ns: int | None) -> Iterator[Said]:
        found_starts.append(start.stamp_ns)
        for stamp_ns, box in answers.items():
            if stamp_ns >= start.stamp_ns:
                yield said(stamp_ns, box)

    outcome = restarts(system, "a", truth)
    overlaps, starts = literal_restarts(answers, truth)
    assert outcome.overlaps == overlaps
    # Nothing is left to be scored after the last label: a start there would be for nothing.
    assert found_starts == [truth[index].stamp_ns for index in starts if index < len(truth) - 1]
    assert outcome.failures == sum(value < 0.5 for value in overlaps)


def test_targets_with_a_single_label_are_refused():
    for protocol in (one_pass, restarts):
        with pytest.raises(EvaluationError, match="'a' has 1 labels"):
            protocol(Scripted(), "a", labels(1))


def test_centre_errors_are_distances_of_the_middles():
    assert centre_error_px(Box(0, 0, 2, 4), Box(3, 4, 2, 4)) == 5.0
    assert centre_error_px(Box(0, 0, 2, 4), Box(-1, -2, 4, 8)) == 0.0
    assert centre_error_px(None, BOX) == math.inf
