"""The rules by which targets that start without a box are judged, and the command `evaluate --start`."""

from __future__ import annotations

import csv
import dataclasses
import math

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.cli import main
from etd_ros.commands import evaluate_simulated as command
from etd_ros.evaluation.starting import (
    AT_REST,
    CLICK_PLACES,
    MOVING,
    START_NS,
    STILL,
    AutoStarts,
    ClickAnswer,
    ClickTrial,
    StartResult,
    Things,
    evaluate_starts,
    kind_of,
    on_sensor,
    starts_in,
)
from etd_ros.evaluation.starting_summary import COLUMNS, by_kind, summarise, write_summaries
from etd_ros.simulation import SUITE, Path, Recipe, Scene, Sprite, Waypoint
from etd_ros.tracking import DiscoveryConfig, TargetReport, TargetState

SIDE = 12


@pytest.fixture(scope="module")
def scene() -> Scene:
    """`thing` comes in from the left, half of it by 0.2 s; `panel` moves, too, but is no target; `post` stands."""
    post = Sprite("post", np.full((30, 8), 0.5), np.ones((30, 8)), Path([Waypoint(0.0, 90, 40)]))
    panel = sprite("panel", [Waypoint(0.0, 30, 60), Waypoint(1.0, 70, 60)], is_target=False)
    thing = sprite("thing", [Waypoint(0.0, -20, 20), Waypoint(0.2, 0, 20), Waypoint(1.0, 80, 20)])
    return Scene(100, 80, 1.0, np.full((80, 100), 0.3), (post, panel, thing))


def sprite(name: str, way: list[Waypoint], *, is_target: bool = True) -> Sprite:
    return Sprite(name, np.full((SIDE, SIDE), 0.8), np.ones((SIDE, SIDE)), Path(way), is_target=is_target)


def ns(time_s: float) -> int:
    return START_NS + round(time_s * 1e9)


def tracking(**boxes: Box) -> list[TargetReport]:
    return [TargetReport(name, TargetState.TRACKING, box, 1.0) for name, box in boxes.items()]


def test_what_never_moves_is_no_thing(scene):
    assert set(Things(scene).boxes(ns(0.5))) == {"panel", "thing"}


def test_a_target_is_awaited_from_when_half_of_it_can_be_seen(scene):
    things = Things(scene)
    assert set(things.first_ns) == {"thing"}
    assert things.first_ns["thing"] == pytest.approx(ns(0.2), abs=20_000_000)
    assert "thing" not in things.boxes(ns(0.15))
    assert "thing" in things.boxes(ns(0.15), 0.02)


def test_boxes_end_at_the_sensors_border(scene):
    box = Things(scene).boxes(ns(0.25))["thing"]
    whole = scene.box("thing", 0.25)
    assert whole.x < 0 == box.x
    assert box.x + box.w == pytest.approx(whole.x + whole.w)
    assert on_sensor(Box(-30.0, 5.0, 10.0, 10.0), scene).w < 0.01


def test_the_first_box_of_a_target_decides_what_it_has_found(scene):
    judged = AutoStarts(Things(scene))
    judged.take(ns(0.3), [TargetReport("auto_1", TargetState.IDLE, None, 0.0)])
    judged.take(ns(0.4), tracking(auto_1=scene.box("thing", 0.4)))
    judged.take(ns(0.5), tracking(auto_1=Box(80, 2, 9, 9)))
    (delay_s,) = judged.delays_s()
    assert delay_s == pytest.approx(0.2, abs=0.02)
    assert (judged.parts, judged.false_starts) == (0, 0)


def test_a_target_that_is_found_again_was_found_the_first_time(scene):
    judged = AutoStarts(Things(scene))
    judged.take(ns(0.4), tracking(auto_1=scene.box("thing", 0.4)))
    judged.take(ns(0.8), tracking(auto_2=scene.box("thing", 0.8)))
    assert judged.delays_s()[0] == pytest.approx(0.2, abs=0.02)


def test_starts_on_pieces_of_things_are_parts_and_others_are_false(scene):
    judged = AutoStarts(Things(scene))
    box = scene.box("thing", 0.5)
    corner = Box(box.x, box.y, 0.5 * box.w, 0.5 * box.h)
    judged.take(ns(0.5), tracking(auto_1=corner, auto_2=scene.box("post", 0.5), auto_3=scene.box("panel", 0.5)))
    assert judged.delays_s() == (None,)
    assert (judged.parts, judged.false_starts) == (1, 1)


def test_two_targets_on_one_thing_are_counted_for_the_frames_on_which_they_are(scene):
    judged = AutoStarts(Things(scene))
    for number, names in enumerate((["a", "b"], ["a"], ["a", "b"], [])):
        time_s = 0.5 + 0.01 * number
        judged.take(ns(time_s), tracking(**{name: scene.box("thing", time_s) for name in names}))
    assert judged.twice_share == 0.5


def test_before_any_frame_nothing_was_twice(scene):
    assert AutoStarts(Things(scene)).twice_share == 0


def test_clicks_that_nothing_answers_say_so(scene):
    """Frames without an event."""
    trial = ClickTrial(Things(scene), 0.5, (0.0, 0.0), DiscoveryConfig())
    for number in range(20, 95):
        trial.take(ns(0.01 * number), np.zeros((80, 100, 2), np.uint8))
    assert trial.answers() == [ClickAnswer(is_middle=True, iou=None)]


def test_only_targets_that_can_be_well_seen_are_clicked(scene):
    things = Things(scene)
    assert ClickTrial(things, 0.15, (0.0, 0.0), DiscoveryConfig()).answers() == []
    assert ClickTrial(things, 0.5, (0.25, 0.25), DiscoveryConfig()).answers() == [ClickAnswer(False, None)]


@pytest.mark.parametrize(
    ("camera", "motion", "kind"),
    [("still", "wander", STILL), ("still", "rest", STILL), ("slide", "cross", MOVING), ("zoom", "rest", AT_REST)],
)
def test_scenes_are_told_apart_by_camera_and_motion(camera, motion, kind):
    assert kind_of(Recipe(("ball",), "wall", camera=camera, motion=motion)) == kind


@pytest.fixture(scope="module")
def ball():
    """The suite's first sequence, shortened."""
    return shortened("ball", 0.85)


def shortened(name: str, duration_s: float):
    return dataclasses.replace(SUITE[name], recipe=dataclasses.replace(SUITE[name].recipe, duration_s=duration_s))


def test_a_ball_before_a_wall_is_found_soon_and_clicks_on_it_give_its_box(ball):
    result = starts_in(ball)
    assert (result.sequence, result.kind, result.duration_s) == ("ball", STILL, 0.85)
    assert len(result.delays_s) == 1
    assert 0 < result.delays_s[0] < 0.3
    assert (result.parts, result.false_starts, result.twice_share) == (0, 0, 0)
    # At 0.8 s there is no time left for an answer.
    assert [click.is_middle for click in result.clicks] == [place == (0, 0) for place in CLICK_PLACES]
    assert min(click.iou for click in result.clicks) > 0.7
    assert result.frame_ms > 0


def test_two_processes_find_what_one_finds():
    sequences = [shortened("ball", 0.3), shortened("spin", 0.3)]
    alone, together = (list(evaluate_starts(sequences, method="etd-nr", jobs=jobs)) for jobs in (1, 2))
    assert alone == together
    assert [(result.sequence, len(result.delays_s)) for result in alone] == [("ball", 1), ("spin", 2)]


def result(**changed) -> StartResult:
    """Of four targets in 2 s: two found soon, one late, one never."""
    clicks = (ClickAnswer(True, 0.9), ClickAnswer(True, None), ClickAnswer(False, 0.3), ClickAnswer(False, 0.4))
    values = {
        "sequence": "here",
        "kind": STILL,
        "duration_s": 2.0,
        "delays_s": (0.1, 0.3, 0.4, None),
        "parts": 3,
        "false_starts": 1,
        "twice_share": 0.1,
        "clicks": clicks,
        "frame_ms": 0.5,
    }
    return StartResult(**{**values, **changed})


def test_figures_are_shares_of_targets_and_clicks_and_rates_in_time():
    summary = summarise("here", [result()])
    assert (summary.targets, summary.soon, summary.ever) == (4, 0.5, 0.75)
    assert (summary.false_per_s, summary.parts_per_s) == (0.5, 1.5)
    assert (summary.clicks, summary.answered, summary.click_iou) == (4, 0.75, 0.4)
    assert (summary.click_middle, summary.click_beside) == (0.5, 0.0)


def test_several_sequences_count_by_their_targets_clicks_and_durations():
    both = summarise("both", [result(), result(delays_s=(), clicks=(), duration_s=6.0, twice_share=0.3, frame_ms=1.5)])
    assert (both.targets, both.soon, both.clicks) == (4, 0.5, 4)
    assert both.false_per_s == 0.25
    assert both.twice_share == pytest.approx(0.2)
    assert both.frame_ms == 1.0


def test_what_there_is_nothing_to_say_of_is_no_number():
    summary = summarise("nothing", [result(delays_s=(), clicks=())])
    figures = (summary.soon, summary.ever, summary.answered, summary.click_iou, summary.click_middle)
    assert all(map(math.isnan, figures))


def test_each_kind_that_occurs_has_its_figures_and_all_have_theirs():
    summaries = by_kind([result(kind=AT_REST), result(), result(kind=AT_REST)])
    assert [(summary.name, summary.targets) for summary in summaries] == [(STILL, 4), (AT_REST, 8), ("all", 12)]


def test_figures_are_written_with_three_decimals_and_empty_where_there_are_none(tmp_path):
    write_summaries(tmp_path / "starts.csv", [summarise("here", [result(clicks=())])])
    header, row = (tmp_path / "starts.csv").read_text().splitlines()
    assert header == ",".join(COLUMNS)
    assert row == "here,4,0.500,0.750,0.500,1.500,0.100,0,,,,,0.500"


@pytest.fixture
def short_suite(monkeypatch):
    """Two sequences of 0.3 s, of two kinds."""
    monkeypatch.setattr(command, "SUITE", {name: shortened(name, 0.3) for name in ("ball", "hand")})


@pytest.mark.usefixtures("short_suite")
def test_the_command_gives_rows_for_sequences_and_kinds_and_a_csv(capsys, tmp_path):
    output = tmp_path / "starts.csv"
    assert main(["evaluate", "--start", "--suite", "--method", "etd-nr", "--write", str(output)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:4] == ["sequence", "targets", "0.3", "s"]
    assert [line[:30].strip() for line in lines[1:]] == ["ball", "hand", STILL, MOVING, "all"]
    assert [line[30:].split()[0] for line in lines[1:]] == ["1", "2", "1", "2", "3"]
    with output.open(newline="") as file:
        assert [row["name"] for row in csv.DictReader(file)] == ["ball", "hand"]


def test_starts_in_random_sequences_are_scored_too(capsys):
    assert main(["evaluate", "--start", "--random", "1", "--seed", "18", "--method", "etd-nr"]) == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("random-18 ")


def test_a_file_that_cannot_be_written_is_refused_before_the_work(tmp_path, capsys):
    assert main(["evaluate", "--start", "--suite", "--write", str(tmp_path)]) == 2
    assert "is a folder" in capsys.readouterr().err


def test_what_to_start_targets_in_must_be_said(capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["evaluate", "--start"])
    assert "--suite" in capsys.readouterr().err
