"""The command `track`: its files, options and methods."""

from __future__ import annotations

import csv
import sys

import command_bags
import cv2
import numpy as np
import pytest
from rerun_files import logged

from etd_ros.boxes import iou
from etd_ros.cli import main
from etd_ros.evaluation import mean_score, read_boxes, read_tracks, score
from etd_ros.tracking import TargetState

STATES = {state.value for state in TargetState}
TIN_HIDDEN_NS = 1_700_000_002_200_000_000, 1_700_000_002_500_000_000
"""While the whole tin of the bundled recording is behind the pillar, and some time after it went there."""


def tracks_of(folder, *options: str) -> list[dict[str, str]]:
    """The rows that `track` writes of a small random bag."""
    output = folder / "tracks.csv"
    bag = folder / "bag"
    if not bag.exists():
        command_bags.sound(bag)
    assert main(["track", str(bag), "--output", str(output), *options]) == 0
    with output.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def truth_file(repository):
    return repository / "bags" / "demo" / "boxes.csv"


@pytest.fixture(scope="module", params=["etd-plus", "etd", "etd-nr", "etd-ftw"])
def method_tracks(request, truth_file, tmp_path_factory):
    """(method, its tracks of the bundled recording)."""
    output = tmp_path_factory.mktemp(request.param) / "tracks.csv"
    arguments = ["track", str(truth_file.parent), "--targets", str(truth_file), "--method", request.param]
    assert main([*arguments, "--output", str(output)]) == 0
    return request.param, read_tracks(output)


def test_every_method_tracks_all_targets_of_the_bundled_recording_from_their_start(method_tracks, truth_file):
    _, tracks = method_tracks
    boxes = read_boxes(truth_file)
    assert set(tracks) == {"ball", "drum", "tin"}
    stamps = {name: [row.stamp_ns for row in rows] for name, rows in tracks.items()}
    assert stamps["ball"] == stamps["drum"] == stamps["tin"] == sorted(set(stamps["tin"]))
    for name, rows in tracks.items():
        assert {row.state for row in rows} <= STATES
        started = [row for row in rows if row.stamp_ns >= boxes[name][0].stamp_ns]
        assert all(row.box is None and row.state == "idle" for row in rows[: len(rows) - len(started)])
        assert started[0].box is not None


def test_every_method_is_as_accurate_on_the_bundled_recording_as_it_has_been(method_tracks, truth_file):
    method, tracks = method_tracks
    least = {"etd-plus": 0.85, "etd": 0.75, "etd-nr": 0.5, "etd-ftw": 0.5}
    assert mean_score(score(tracks, read_boxes(truth_file))).ap > least[method]


def test_no_method_claims_to_see_the_tin_while_it_is_hidden(method_tracks):
    _, tracks = method_tracks
    first_ns, last_ns = TIN_HIDDEN_NS
    hidden = [row for row in tracks["tin"] if first_ns <= row.stamp_ns <= last_ns]
    assert {row.score for row in hidden} == {0.0}
    assert {row.state for row in hidden} <= {"recovering", "lost"}
    assert {row.box for row in hidden} == {None}


def test_the_hidden_tin_is_found_again_only_with_recovery(method_tracks, truth_file):
    method, tracks = method_tracks
    last = tracks["tin"][-1]
    if method == "etd-nr":
        assert (last.state, last.box) == ("lost", None)
        return
    assert last.state == "tracking"
    assert last.score > 0
    assert last.box is not None
    assert iou(np.array([last.box]), read_boxes(truth_file)["tin"][-1].box)[0] > 0.5


def test_a_row_for_every_target_and_frame_with_the_columns_of_the_design(tmp_path):
    rows = tracks_of(tmp_path, "--target", "first:10,10,20,20", "--target", "second:30,20,16,12")
    assert list(rows[0]) == ["stamp_ns", "target", "x", "y", "w", "h", "score", "state"]
    assert [row["target"] for row in rows] == ["first", "second"] * (len(rows) // 2)
    assert len(rows) > 2
    for row in rows:
        assert row["state"] in STATES
        assert 0 <= float(row["score"]) <= 1
        assert len({row[column] == "" for column in "xywh"}) == 1


def test_a_target_waits_for_its_stamp(tmp_path):
    stamp_ns = command_bags.START_NS + 25_000_000
    rows = tracks_of(tmp_path, "--target", f"late:10,10,20,20@{stamp_ns}", "--method", "etd-ftw")
    for row in rows:
        assert (row["state"] == "idle") == (int(row["stamp_ns"]) < stamp_ns)
    assert {row["state"] == "idle" for row in rows} == {True, False}


def test_targets_of_a_file_and_of_the_command_line_are_tracked_together(tmp_path):
    boxes = tmp_path / "boxes.csv"
    boxes.write_text("target,stamp_ns,x,y,w,h\nfiled,1000000000,10,10,20,20\nfiled,1020000000,1,1,2,2\n")
    rows = tracks_of(tmp_path, "--targets", str(boxes), "--target", "typed:30,20,16,12")
    assert {row["target"] for row in rows} == {"filed", "typed"}


def test_a_parameter_from_the_command_line_wins_over_the_file_and_both_over_the_default(tmp_path):
    config = tmp_path / "parameters.yaml"
    config.write_text("/**:\n  ros__parameters:\n    fixed_window:\n      window_s: 0.02\n")
    common = ("--target", "thing:10,10,20,20", "--method", "etd-ftw")
    counts = [
        len(tracks_of(tmp_path, *common, *options))
        for options in (
            (),
            ("--config", str(config)),
            ("--config", str(config), "--set", "fixed_window.window_s=5e-3"),
        )
    ]
    # 50 ms of events in windows of 9, 20 and 5 ms; the last window is not over.
    assert counts == [5, 2, 9]


def test_a_list_can_be_set(tmp_path):
    rows = tracks_of(tmp_path, "--target", "thing:10,10,20,20", "--set", "atsltd.nzge_interval=[0.01, 0.02]")
    assert len(rows) > len(tracks_of(tmp_path, "--target", "thing:10,10,20,20"))


def pictures_of(video) -> list[np.ndarray]:
    capture = cv2.VideoCapture(str(video))
    pictures = []
    while (answer := capture.read())[0]:
        pictures.append(answer[1])
    return pictures


def whole_boxes(folder) -> list[str]:
    """Options for a target with truth at later times."""
    boxes = folder / "boxes.csv"
    lines = [f"thing,{1_000_000_000 + step * 5_000_000},10,10,20,20" for step in range(10)]
    boxes.write_text("\n".join(["target,stamp_ns,x,y,w,h", *lines]) + "\n")
    return ["--targets", str(boxes)]


@pytest.mark.parametrize("method", ["etd", "etd-nr"])
@pytest.mark.parametrize("slow", [1, 20])
def test_the_video_lasts_as_long_as_the_recording_or_as_many_times_as_it_is_slowed(tmp_path, method, slow):
    video = tmp_path / "video.mp4"
    options = ("--video", str(video), "--slow", str(slow), "--method", method)
    stamps_ns = [int(row["stamp_ns"]) for row in tracks_of(tmp_path, "--target", "thing:10,10,20,20", *options)]
    wanted = (stamps_ns[-1] - stamps_ns[0]) * 1e-9 * slow * 30
    assert len(pictures_of(video)) == pytest.approx(wanted, abs=1)


def test_proposals_and_truth_are_drawn_into_the_video_when_asked_for(tmp_path):
    targets = whole_boxes(tmp_path)
    shown = []
    for options in ([], ["--proposals"], ["--truth", targets[1]]):
        tracks_of(tmp_path, *targets, "--method", "etd", "--video", str(tmp_path / "video.mp4"), *options)
        shown.append(pictures_of(tmp_path / "video.mp4")[0].astype(int))
    plain, proposals, truth = shown
    assert np.abs(proposals - plain).max() > 50
    assert np.abs(truth - plain).max() > 50


def test_the_plot_has_a_panel_for_the_targets_with_truth(tmp_path):
    targets = whole_boxes(tmp_path)
    heights = []
    for options in (targets, ["--target", "thing:10,10,20,20", "--truth", targets[1]]):
        tracks_of(tmp_path, *options, "--target", "unlabelled:30,9,9,9", "--plot", str(tmp_path / "plot.png"))
        heights.append(cv2.imread(str(tmp_path / "plot.png")).shape[0])
        (tmp_path / "plot.png").unlink()
    assert heights == [280, 280], "the height of one panel"


def test_the_plot_of_written_tracks_is_that_of_tracking_with_the_scores_beside_it(tmp_path, capsys):
    targets = whole_boxes(tmp_path)
    tracks_of(tmp_path, *targets, "--plot", str(tmp_path / "tracked.png"))
    plot = ["plot", str(tmp_path / "tracks.csv"), targets[1], "--output", str(tmp_path / "plotted.png")]
    capsys.readouterr()
    assert main(plot) == 0
    tracked, plotted = (cv2.imread(str(tmp_path / name)) for name in ("tracked.png", "plotted.png"))
    np.testing.assert_array_equal(tracked[40:], plotted[40:])
    found = score(read_tracks(tmp_path / "tracks.csv"), read_boxes(tmp_path / "boxes.csv"))["thing"]
    assert capsys.readouterr().out == f"thing: AP {found.ap:.3f}, AR {found.ar:.3f} at 9 labelled times\n"


def test_a_target_of_another_name_is_plotted_against_the_boxes_that_it_overlaps(tmp_path):
    truth = ["--truth", whole_boxes(tmp_path)[1]]
    other = ["--target", "other:10,10,20,20"]
    tracks_of(tmp_path, *other, *truth, "--plot", str(tmp_path / "tracked.png"))
    plot = ["plot", str(tmp_path / "tracks.csv"), truth[1], "--output", str(tmp_path / "plotted.png")]
    assert main(plot) == 0
    tracked, plotted = (cv2.imread(str(tmp_path / name)) for name in ("tracked.png", "plotted.png"))
    np.testing.assert_array_equal(tracked[40:], plotted[40:])


def test_tracks_that_no_boxes_belong_to_are_written_but_not_plotted(tmp_path, capsys):
    truth, bag = whole_boxes(tmp_path)[1], command_bags.sound(tmp_path / "bag")
    tracks, plot = tmp_path / "tracks.csv", tmp_path / "plot.png"
    arguments = ["track", str(bag), "--target", "far:44,44,9,9@1000000000", "--method", "etd-ftw", "--truth", truth]
    assert main([*arguments, "--output", str(tracks), "--plot", str(plot)]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("etd_ros: ")]
    for word in (
        "boxes.csv: no tracked target has boxes to be held against",
        "tracks.csv is written",
        "the same clock",
    ):
        assert word in line
    assert "far" in read_tracks(tracks)
    assert not plot.exists()


def test_targets_with_a_single_label_of_their_own_are_refused_before_the_work(place, tmp_path, capsys):
    boxes = tmp_path / "boxes.csv"
    boxes.write_text("target,stamp_ns,x,y,w,h\nthing,1,10,10,20,20\nother,1,10,10,20,20\nother,2,10,10,20,20\n")
    arguments = ["track", str(command_bags.sound(tmp_path / "bag")), "--target", "thing:10,10,20,20"]
    assert main([*arguments, "--truth", str(boxes), "--plot", "plot.png", "--output", "tracks.csv"]) == 2
    assert "at several times" in capsys.readouterr().err
    assert list(place.iterdir()) == []


@pytest.mark.parametrize(("method", "is_told"), [("etd-plus", True), ("etd-ftw", False)])
def test_a_method_without_proposals_says_that_none_are_drawn(tmp_path, capsys, method, is_told):
    options = ("--method", method, "--video", str(tmp_path / "video.mp4"), "--proposals")
    tracks_of(tmp_path, "--target", "thing:10,10,20,20", *options)
    told = [line for line in capsys.readouterr().err.splitlines() if "proposals" in line]
    line = "--proposals: 'etd-plus' makes no proposals, so none are drawn: choose one of etd, etd-nr, etd-ftw"
    assert told == ([line] if is_told else [])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--plot", "plot.png"], "--truth BOXES.csv"),
        (["--plot", "absent/plot.png"], "absent/plot.png"),
        (["--plot", "plot.txt"], "plot.txt: pictures are PNG files"),
        (["--truth", "absent.csv"], "absent.csv"),
        (["--proposals"], "--video"),
        (["--slow", "4"], "--video"),
        (["--video", "video.mp4", "--slow", "0"], "times as slow"),
    ],
)
def test_pictures_that_cannot_be_made_are_refused_before_the_work(place, tmp_path, capsys, options, words):
    bag = command_bags.sound(tmp_path / "bag")
    arguments = ["track", str(bag), "--target", "thing:10,10,20,20", "--output", "tracks.csv", *options]
    assert main(arguments) == 2
    assert words in capsys.readouterr().err
    assert list(place.iterdir()) == []


def test_only_the_results_are_left_behind(tmp_path):
    place = tmp_path / "place"
    place.mkdir()
    bag = command_bags.sound(tmp_path / "bag")
    results = ("--output", str(place / "tracks.csv"), "--video", str(place / "video.mp4"))
    assert main(["track", str(bag), "--target", "thing:10,10,20,20", *results]) == 0
    assert sorted(path.name for path in place.iterdir()) == ["tracks.csv", "video.mp4"]


def test_tracking_is_reproducible(tmp_path):
    first, again = (tracks_of(tmp_path, "--target", "thing:10,10,20,20", "--target", "b:30,9,9,9") for _ in range(2))
    assert first == again


def test_moving_objects_are_tracked_without_any_target_given(repository, tmp_path):
    output = tmp_path / "tracks.csv"
    boxes, plot = repository / "bags" / "demo" / "boxes.csv", tmp_path / "plot.png"
    pictures = ["--truth", str(boxes), "--plot", str(plot)]
    assert main(["track", str(boxes.parent), "--auto", "--output", str(output), *pictures]) == 0
    truth = read_boxes(boxes)
    tracks = read_tracks(output)
    assert tracks
    assert set(tracks) == {f"auto_{number}" for number in range(1, len(tracks) + 1)}
    found = {
        name
        for name, labels in truth.items()
        for rows in tracks.values()
        if score({name: rows}, {name: labels})[name].ar > 0.3
    }
    assert found
    assert cv2.imread(str(plot)).shape[0] == pytest.approx(110 * (1 + 1.55 * len(truth)), abs=1), (
        "a panel for each label"
    )


def test_a_target_after_the_recording_is_told_and_the_others_are_tracked(tmp_path, capsys):
    bag = command_bags.sound(tmp_path / "bag")
    late = f"late:10,10,20,20@{command_bags.START_NS + 10**12}"
    tracks = tmp_path / "tracks.csv"
    arguments = ["track", str(bag), "--target", "thing:10,10,20,20", "--target", late, "--output", str(tracks)]
    assert main(arguments) == 0
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "late" in line]
    assert "after the last frame" in line
    assert "events' clock" in line
    assert any(box.box is not None for box in read_tracks(tracks)["thing"])


def test_a_click_is_tracked_and_one_in_vain_is_told(repository, tmp_path, capsys):
    output = tmp_path / "tracks.csv"
    demo = repository / "bags" / "demo"
    label = read_boxes(demo / "boxes.csv")["ball"][10]
    x, y = label.box.center
    clicks = ["--click", f"ball:{x},{y}@{label.stamp_ns}", "--click", f"nothing:1,1@{label.stamp_ns}"]
    wait = ["--set", "discovery.click_wait_s=0.2"]
    assert main(["track", str(demo), *clicks, *wait, "--output", str(output)]) == 0
    assert set(read_tracks(output)) == {"ball"}
    assert read_tracks(output)["ball"][0].stamp_ns > label.stamp_ns
    assert "'nothing' at (1, 1): nothing has moved there" in capsys.readouterr().err


def test_a_click_for_which_nothing_is_found_before_the_recording_ends_is_told(repository, tmp_path, capsys):
    demo = repository / "bags" / "demo"
    end_ns = read_boxes(demo / "boxes.csv")["tin"][-1].stamp_ns
    clicks = ["--click", f"nothing:1,1@{end_ns - 300_000_000}", "--click", f"late:1,1@{end_ns + 10**12}"]
    assert main(["track", str(demo), *clicks, "--output", str(tmp_path / "tracks.csv")]) == 0
    late, in_vain = capsys.readouterr().err.splitlines()[-2:]
    assert "'nothing' at (1, 1): nothing is found there before the recording ends, and nothing starts" in in_vain
    assert "'late' starts at" in late


def test_the_log_for_the_rerun_viewer_has_the_boxes_of_the_tracks(tmp_path):
    file = tmp_path / "log.rrd"
    rows = tracks_of(tmp_path, "--target", "thing:10,10,20,20", "--rerun", str(file))
    boxes = logged(file)["boxes"]
    assert [stamp for stamp, _ in boxes] == [int(row["stamp_ns"]) for row in rows]
    with_box = [(row, logged_box) for row, (_, logged_box) in zip(rows, boxes, strict=True) if row["w"]]
    assert with_box
    for row, logged_box in with_box:
        half_width, half_height = logged_box["half_sizes"][0]
        left, top = logged_box["centers"][0][0] - half_width, logged_box["centers"][0][1] - half_height
        written = [float(row[name]) for name in ("x", "y", "w", "h")]
        assert [left, top, 2 * half_width, 2 * half_height] == pytest.approx(written, abs=1e-2)


def test_without_the_rerun_sdk_one_line_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    bag, output = command_bags.sound(tmp_path / "bag"), tmp_path / "tracks.csv"
    options = ["--target", "thing:10,10,20,20", "--rerun", str(tmp_path / "log.rrd")]
    assert main(["track", str(bag), "--output", str(output), *options]) == 2
    assert capsys.readouterr().err == "etd_ros: the Rerun viewer needs its SDK: pip install rerun-sdk\n"
    assert not output.exists()
