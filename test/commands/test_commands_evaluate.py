"""The command `evaluate`, and the rules by which a track of a simulated target is judged."""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.cli import main
from etd_ros.commands import evaluate_simulated as command
from etd_ros.evaluation import TimedBox, TrackRow, suite
from etd_ros.evaluation.scoring import Score
from etd_ros.evaluation.suite import COLUMNS, START_NS, Judge, TargetResult, evaluate, write_results
from etd_ros.simulation import SUITE, Path, Scene, Sprite, Waypoint, absent_times, true_boxes
from etd_ros.systems.registry import SYSTEMS

TRACKING, RECOVERING, LOST, IDLE = "tracking", "recovering", "lost", "idle"
NOWHERE = Box(90.0, 70.0, 8.0, 8.0)
FRAME_S = 0.01


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A square goes behind a pillar at about 0.3 s, comes out at about 0.5 s and has left at about 0.8 s."""
    size = (12, 12)
    way = [Waypoint(0.0, 10, 24), Waypoint(0.3, 40, 24), Waypoint(0.5, 60, 24), Waypoint(0.8, 112, 24)]
    thing = Sprite("thing", np.full(size, 0.8), np.ones(size), Path(way))
    pillar = Sprite("pillar", np.full((30, 22), 0.5), np.ones((30, 22)), Path([Waypoint(0.0, 50, 24)]), is_target=False)
    return Scene(100, 48, 1.2, np.full((48, 100), 0.3), (thing, pillar))


def ns(time_s: float) -> int:
    return START_NS + round(time_s * 1e9)


def judged(scene: Scene, says) -> TargetResult:
    """What is made of a track; `says(time_s)` gives (state, box), or (state, None) or (TRACKING, "truth")."""
    times_s = [number * FRAME_S for number in range(10, 120)]
    labels = [TimedBox(ns(time_s), box) for time_s, box in true_boxes(scene, "thing", times_s)]
    track = []
    for time_s in times_s:
        state, box = says(time_s)
        track.append(TrackRow(ns(time_s), "thing", scene.box("thing", time_s) if box == "truth" else box, 0.5, state))
    return Judge(scene, "thing", track, labels).result("here", Score(0.5, 0.5, len(labels) - 1))


def spans(scene: Scene) -> tuple[float, float, float]:
    hidden, left = absent_times(scene, "thing")
    return hidden.start_s, hidden.end_s, left.start_s


def test_a_track_that_is_the_truth_and_then_says_lost_survives_all(scene):
    _, _, left_s = spans(scene)
    result = judged(scene, lambda time_s: (TRACKING, "truth") if time_s < left_s + 0.05 else (LOST, None))
    assert (result.occlusions, result.survived, result.left) == (1, 1, 1)
    assert result.left_s == pytest.approx(0.05, abs=FRAME_S)
    assert result.false_share == 0
    assert (result.recoveries, result.wrong_recoveries) == (0, 0)


def test_a_track_that_recovers_in_time_survives_and_one_that_is_late_does_not(scene):
    hidden_s, seen_s, left_s = spans(scene)

    def found_after(delay_s: float) -> TargetResult:
        def says(time_s: float):
            if hidden_s <= time_s < seen_s + delay_s:
                return RECOVERING, None
            return (TRACKING, "truth") if time_s < left_s else (LOST, None)

        return judged(scene, says)

    in_time, late = found_after(0.07), found_after(0.17)
    assert (in_time.survived, in_time.recoveries, in_time.wrong_recoveries) == (1, 1, 0)
    assert (late.survived, late.recoveries) == (0, 1)


def test_an_occlusion_of_more_than_half_a_second_is_counted_apart(scene, monkeypatch):
    result = judged(scene, lambda time_s: (TRACKING, "truth"))
    assert (result.occlusions, result.survived, result.longer, result.longer_survived) == (1, 1, 0, 0)
    hidden_s, seen_s, _ = spans(scene)
    monkeypatch.setattr(suite, "OCCLUSION_MAX_S", seen_s - hidden_s)
    result = judged(scene, lambda time_s: (TRACKING, "truth"))
    assert (result.occlusions, result.survived, result.longer, result.longer_survived) == (0, 0, 1, 1)


def test_a_track_that_loses_it_again_after_an_occlusion_does_not_survive(scene):
    _, seen_s, _ = spans(scene)
    result = judged(scene, lambda time_s: (TRACKING, "truth" if time_s < seen_s + 0.15 else NOWHERE))
    assert result.survived == 0


def test_a_box_that_stays_after_its_target_has_left_is_false_and_counts_for_the_whole_absence(scene):
    _, _, left_s = spans(scene)
    result = judged(scene, lambda time_s: (TRACKING, NOWHERE))
    assert result.left_s == pytest.approx(1.2 - left_s, abs=0.01)
    assert result.false_share == 1


def test_a_target_that_was_lost_before_it_left_is_told_at_once(scene):
    result = judged(scene, lambda time_s: (TRACKING, "truth") if time_s < 0.25 else (LOST, None))
    assert result.left_s == 0


def found_again(scene, lost_s: float, found_s: float, box: str | Box) -> TargetResult:
    """What is made of a track that is right, but for a loss that ends with one row of another box."""

    def says(time_s: float):
        if lost_s <= time_s < found_s:
            return RECOVERING, None
        return TRACKING, box if found_s <= time_s < found_s + FRAME_S else "truth"

    return judged(scene, says)


def shifted(scene, time_s: float, share: float) -> Box:
    """Its box at a time, beside where it is by a share of its width."""
    box = scene.box("thing", time_s)
    return box._replace(x=box.x + share * box.w)


def test_recoveries_elsewhere_are_wrong(scene):
    result = found_again(scene, 0.2, 0.22, NOWHERE)
    assert (result.recoveries, result.wrong_recoveries) == (1, 1)


@pytest.mark.parametrize(("share", "wrong"), [(0.0, 0), (0.25, 0), (0.5, 1)])
def test_what_is_found_while_it_is_hidden_is_right_where_its_box_is_on_it(scene, share, wrong):
    hidden_s, seen_s, _ = spans(scene)
    found_s = (hidden_s + seen_s) / 2
    result = found_again(scene, hidden_s - 0.02, found_s, shifted(scene, found_s, share))
    assert (result.recoveries, result.wrong_recoveries) == (1, wrong)


def test_a_box_that_hardly_touches_what_can_be_seen_is_no_wrong_recovery(scene):
    # An IoU of a third: the box is on it, if not well.
    result = found_again(scene, 0.2, 0.22, shifted(scene, 0.22, 0.5))
    assert (result.recoveries, result.wrong_recoveries) == (1, 0)


def test_what_is_found_when_it_has_left_is_wrong_even_where_it_went(scene):
    _, _, left_s = spans(scene)
    result = found_again(scene, left_s - 0.02, left_s + 0.05, "truth")
    assert (result.recoveries, result.wrong_recoveries) == (1, 1)


def test_a_start_is_no_recovery(scene):
    result = judged(scene, lambda time_s: (IDLE, None) if time_s < 0.15 else (TRACKING, "truth"))
    assert result.recoveries == 0


def test_the_systems_are_listed_one_a_line_with_what_they_are(capsys):
    assert main(["evaluate", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(SYSTEMS)
    assert [line.split(maxsplit=1)[1] for line in lines] == [system.description for system in SYSTEMS.values()]


@pytest.fixture
def short_suite(monkeypatch):
    """Two sequences of 0.3 s."""
    short = {
        name: dataclasses.replace(SUITE[name], recipe=dataclasses.replace(SUITE[name].recipe, duration_s=0.3))
        for name in ("ball", "spin")
    }
    monkeypatch.setattr(command, "SUITE", short)


@pytest.mark.usefixtures("short_suite")
def test_the_suite_gives_a_row_for_each_sequence_and_a_csv_with_one_for_each_target(capsys, tmp_path):
    output = tmp_path / "suite.csv"
    assert main(["evaluate", "--suite", "--method", "etd-nr", "--write", str(output)]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [row[:2] for row in rows[1:]] == [["ball", "1"], ["spin", "2"], ["all", "3"]]
    with output.open(newline="") as file:
        written = list(csv.DictReader(file))
    assert list(written[0]) == list(COLUMNS)
    assert [(row["sequence"], row["target"]) for row in written] == [
        ("ball", "ball_1"), ("spin", "panel_1"), ("spin", "irregular_2")
    ]  # fmt: skip
    mean = sum(float(row["ap"]) for row in written) / 3
    assert float(rows[-1][2]) == pytest.approx(mean, abs=0.0011)
    assert {len(row["ap"].partition(".")[2]) for row in written} == {3}
    assert all(row["labels"] == "19" for row in written)


def test_two_processes_find_what_one_finds():
    recipes = (dataclasses.replace(SUITE[name].recipe, duration_s=0.25) for name in ("ball", "spin"))
    sequences = [
        dataclasses.replace(SUITE[name], recipe=recipe) for name, recipe in zip(("ball", "spin"), recipes, strict=True)
    ]
    alone, together = (list(evaluate(sequences, method="etd-nr", jobs=jobs)) for jobs in (1, 2))
    assert alone == together
    assert [[result.sequence for result in results] for results in alone] == [["ball"], ["spin", "spin"]]


def test_targets_that_start_later_have_fewer_labels():
    sequence = dataclasses.replace(SUITE["ball"], recipe=dataclasses.replace(SUITE["ball"].recipe, duration_s=0.25))
    labels = [
        result.labels
        for late_s in (0.1, 0.2)
        for results in evaluate([sequence], method="etd-nr", first_label_s=late_s)
        for result in results
    ]
    assert labels == [14, 4]


def test_random_sequences_and_settings_are_taken(capsys):
    arguments = [
        "evaluate",
        "--random",
        "1",
        "--seed",
        "2",
        "--method",
        "etd-nr",
        "--set",
        "atsltd.max_duration_s=0.03",
    ]
    assert main(arguments) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("random-2 ")


@pytest.mark.parametrize(
    ("seed", "rows", "left_out"),
    [
        (33, [["random-33", "0", *["-"] * 9], ["random-34"], ["all"]], "irregular_1 of random-33"),
        (114, [["random-114", "1"], ["random-115"], ["all"]], "plain_1 of random-114"),
    ],
)
def test_targets_that_are_hidden_all_the_time_are_left_out_and_named(capsys, seed, rows, left_out):
    assert main(["evaluate", "--random", "2", "--seed", str(seed), "--method", "etd-nr"]) == 0
    captured = capsys.readouterr()
    printed = [line.split() for line in captured.out.splitlines()[1:]]
    assert [row[: len(expected)] for row, expected in zip(printed, rows, strict=True)] == rows
    (line,) = captured.err.splitlines()
    assert line.endswith(f": {left_out}")


def test_a_file_that_cannot_be_written_is_refused(tmp_path, capsys):
    assert main(["evaluate", "--suite", "--write", str(tmp_path)]) == 2
    assert "is a folder" in capsys.readouterr().err


@pytest.mark.usefixtures("short_suite")
def test_the_suite_has_other_scenes_with_another_seed(capsys):
    tables = []
    for seed in ([], ["--seed", "7"], ["--seed", "7"]):
        assert main(["evaluate", "--suite", "--method", "etd-nr", *seed]) == 0
        tables.append(capsys.readouterr().out)
    own, other, again = tables
    assert own != other == again


def test_results_are_written_whole_with_three_decimals(tmp_path):
    result = TargetResult("here", "thing", 0.12345, 1.0, 9, 1, 0, 2, 1, 1, 0.25, 0.5, 2, 1)
    write_results(tmp_path / "results.csv", [result])
    lines = (tmp_path / "results.csv").read_text().splitlines()
    assert lines[1] == "here,thing,0.123,1.000,9,1,0,2,1,1,0.250,0.500,2,1"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--suite", "--only", "moon"], "unknown sequence 'moon'"),
        (["--suite", "--method", "guess"], "unknown method 'guess'"),
        (["--suite", "--jobs", "0"], "--jobs 0"),
        (["--random", "0"], "--random 0"),
        (["--random", "1", "--seed", "-1"], "--seed -1"),
        (["--suite", "--seed", "-1"], "--seed -1"),
        (["--random", "1", "--only", "ball"], "--only"),
        (["--suite", "--set", "moon=1"], "moon"),
    ],
)
def test_what_cannot_be_evaluated_is_refused_in_one_line(capsys, arguments, message):
    assert main(["evaluate", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
