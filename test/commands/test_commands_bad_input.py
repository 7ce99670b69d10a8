"""Bad input: one line that says what, where and what to do; exit code 2; nothing half-written."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import command_bags
import pytest

from etd_ros.cli import main

TARGET = "thing:10,10,20,20"
DAMAGED = [
    (command_bags.no_event_topic, "/clock"),
    (command_bags.two_topics, "/left/events"),
    (command_bags.unknown_encoding, "nono"),
    (command_bags.message_cut_short, "cut short"),
    (command_bags.no_width, "0x48"),
    (command_bags.too_high, "64x65536"),
    (command_bags.truncated_storage, "truncated or damaged"),
    (command_bags.without_messages, "bag"),
]


@pytest.fixture
def bag(tmp_path) -> str:
    return str(command_bags.sound(tmp_path / "sound"))


def assert_refused(capsys, place: Path, arguments: list[str], *words: str) -> None:
    before = sorted(place.rglob("*"))
    assert main(arguments) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("etd_ros: ")
    assert captured.err.count("\n") == 1
    assert captured.err.endswith("\n")
    for word in words:
        assert word in captured.err
    assert captured.out == ""
    assert sorted(place.rglob("*")) == before, "something was left behind"


def track(recording: object, *options: str, target: str = TARGET) -> list[str]:
    return ["track", str(recording), "--output", "tracks.csv", *(["--target", target] if target else []), *options]


@pytest.mark.parametrize(("damage", "word"), DAMAGED, ids=lambda value: getattr(value, "__name__", ""))
@pytest.mark.parametrize("command", ["track", "info"])
def test_a_damaged_bag_is_refused(capsys, place, tmp_path, command, damage: Callable[[Path], Path], word):
    recording = damage(tmp_path / "the_bag")
    arguments = track(recording, "--video", "video.mp4") if command == "track" else ["info", str(recording)]
    assert_refused(capsys, place, arguments, "the_bag", word)


def test_several_event_topics_are_listed_and_one_can_be_chosen(capsys, place, tmp_path):
    recording = command_bags.two_topics(tmp_path / "bag")
    assert_refused(capsys, place, track(recording), "/left/events", "/right/events", "--topic")
    assert_refused(capsys, place, track(recording, "--topic", "/middle/events"), "/middle/events", "/left/events")
    assert main(track(recording, "--topic", "/right/events")) == 0


@pytest.mark.parametrize("name", ["missing.bag", "missing", "missing.raw"])
def test_a_missing_recording_is_refused(capsys, place, name):
    assert_refused(capsys, place, track(place / name), name, "no such file")


@pytest.mark.parametrize("name", ["empty.bag", "empty.mcap", "empty.db3", "empty.aedat4", "empty.raw", "empty.txt"])
def test_an_empty_file_is_refused(capsys, place, tmp_path, name):
    (tmp_path / name).touch()
    assert_refused(capsys, place, track(tmp_path / name), name, "empty")


@pytest.mark.parametrize("name", ["junk.bag", "junk.mcap", "junk.db3", "junk.aedat4", "junk.raw", "junk.txt", "junk"])
def test_a_file_of_something_else_is_refused(capsys, place, tmp_path, name):
    (tmp_path / name).write_bytes(bytes(range(256)) * 40)
    assert_refused(capsys, place, track(tmp_path / name), name)


def test_a_folder_without_a_recording_is_refused(capsys, place, tmp_path):
    (tmp_path / "folder").mkdir()
    assert_refused(capsys, place, track(tmp_path / "folder"), "folder")


@pytest.mark.parametrize("size", ["0x48", "64x0", "65536x48", "64x70000"])
def test_an_impossible_size_is_refused(capsys, place, tmp_path, size):
    (tmp_path / "events.txt").write_text("0.1 6 4 1\n")
    assert_refused(capsys, place, track(tmp_path, "--size", size), size, "65535")


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("thing:70,10,20,20", ("thing", "off the 64x48 sensor")),
        ("thing:-30,10,20,20", ("thing", "off the 64x48 sensor")),
        ("thing:10,10,0,20", ("thing", "no area")),
        ("thing:10,10,20,-1", ("thing", "no area")),
        ("thing:10,10,nan,20", ("thing", "not finite")),
        (f"thing:10,10,20,20@{command_bags.START_NS // 2}", ("thing", "before the first event")),
        (f"thing:10,10,20,20@{command_bags.START_NS + 10**12}", ("thing", "after the last frame")),
        ("thing:10,10,20", ("thing:10,10,20", "NAME:X,Y,W,H")),
        ("10,10,20,20", ("10,10,20,20", "NAME:X,Y,W,H")),
        (":10,10,20,20", ("needs a name",)),
        ("thing:10,10,20,20@-5", ("stamp",)),
        ("a,b:10,10,20,20", ("a,b", "unusable")),
    ],
)
def test_a_target_that_cannot_be_is_refused(capsys, place, bag, target, words):
    assert_refused(capsys, place, track(bag, "--video", "video.mp4", target=target), *words)


def test_no_target_is_refused(capsys, place, bag):
    assert_refused(capsys, place, track(bag, target=""), "--targets", "--target")


def test_a_target_given_twice_is_refused(capsys, place, bag, tmp_path):
    (tmp_path / "boxes.csv").write_text("target,stamp_ns,x,y,w,h\nthing,1000000000,10,10,20,20\n")
    assert_refused(capsys, place, track(bag, "--target", TARGET), "'thing'", "twice")
    assert_refused(capsys, place, track(bag, "--targets", str(tmp_path / "boxes.csv")), "'thing'", "twice")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, ("cannot be read",)),
        ("", ("empty",)),
        ("target,stamp_ns,x,y,w,h\n", ("holds no box",)),
        ("target,stamp_ns,x,y,w\nthing,1000000000,1,2,3\n", ("line 1", "column h")),
        ("target,stamp_ns,x,y,w,h\nthing,1000000000,1,2,3\n", ("line 2", "5 cells")),
        ("target,stamp_ns,x,y,w,h\nthing,soon,1,2,3,4\n", ("line 2", "stamp_ns 'soon'")),
        ("target,stamp_ns,x,y,w,h\nthing,1000000000,1,2,3,many\n", ("line 2", "h 'many'")),
        ("target,stamp_ns,x,y,w,h\nthing,1000000000,1,2,0,4\n", ("line 2", "no area")),
        ("target,stamp_ns,x,y,w,h\nthing,1000000000,100,2,3,4\n", ("thing", "off the 64x48 sensor")),
        ("target,stamp_ns,x,y,w,h\nthing,500000000,10,2,3,4\n", ("thing", "before the first event")),
        ("target,stamp_ns,x,y,w,h\nthing,1000000000,inf,2,3,4\n", ("line 2", "finite")),
    ],
)
def test_a_wrong_file_of_boxes_is_refused(capsys, place, bag, tmp_path, content, words):
    boxes = tmp_path / "boxes.csv"
    if content is not None:
        boxes.write_text(content)
    assert_refused(capsys, place, track(bag, "--targets", str(boxes), target=""), *words)


@pytest.mark.parametrize(
    ("output", "video", "word"),
    [
        ("missing/tracks.csv", "video.mp4", "missing/tracks.csv"),
        ("file/tracks.csv", "video.mp4", "file/tracks.csv"),
        (".", "video.mp4", "folder"),
        ("/", "video.mp4", "folder"),
        ("folder", "video.mp4", "folder"),
        ("tracks.csv", "missing/video.mp4", "missing/video.mp4"),
        ("tracks.csv", "folder", "folder"),
        ("tracks.csv", "video.avi", "video.avi"),
    ],
)
def test_an_output_that_cannot_be_written_is_refused(capsys, place, bag, output, video, word):
    (place / "folder").mkdir()
    (place / "file").touch()
    assert_refused(capsys, place, ["track", bag, "--target", TARGET, "--output", output, "--video", video], word)


def test_an_output_that_is_no_regular_file_is_not_replaced_by_one(capsys, place, bag):
    os.mkfifo(place / "pipe")
    assert_refused(capsys, place, ["track", bag, "--target", TARGET, "--output", "pipe"], "pipe", "no regular file")
    assert (place / "pipe").is_fifo()


def test_an_older_result_survives_a_failure(capsys, place, tmp_path):
    (place / "tracks.csv").write_text("older")
    assert main(track(command_bags.message_cut_short(tmp_path / "bag"))) == 2
    assert (place / "tracks.csv").read_text() == "older"


@pytest.mark.parametrize("name", ["bag.mcap", "metadata.yaml"])
@pytest.mark.parametrize("command", ["track", "calibrate", "nzge"])
def test_no_file_in_the_folder_of_a_recording_is_overwritten(capsys, place, tmp_path, command, name):
    recording = command_bags.sound(tmp_path / "bag")
    before = (recording / name).read_bytes()
    arguments = [command, str(recording), "--output", str(recording / name)]
    assert_refused(capsys, place, [*arguments, *(["--target", TARGET] if command == "track" else [])], name, "is read")
    assert (recording / name).read_bytes() == before


@pytest.mark.parametrize("command", ["track", "calibrate", "nzge"])
def test_the_parameter_file_is_not_overwritten(capsys, place, bag, tmp_path, command):
    config = tmp_path / "sensor.yaml"
    config.write_text("/**:\n  ros__parameters:\n    atsltd: {cell_size: 4}\n")
    arguments = [command, bag, "--config", str(config), "--output", str(config)]
    assert_refused(
        capsys, place, [*arguments, *(["--target", TARGET] if command == "track" else [])], "sensor.yaml", "is read"
    )


def test_tracks_beside_the_recording_are_written_and_written_again(place, bag, tmp_path):
    tracks = Path(bag) / "tracks.csv"
    for _ in range(2):
        assert main(["track", bag, "--target", TARGET, "--output", str(tracks)]) == 0
        assert tracks.is_file()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--method", "guess"], ("guess", "etd-nr")),
        (["--set", "tracking.failure_iou=7"], ("failure_iou", "[0, 1]")),
        (["--set", "tracking.failure_iou=nan"], ("failure_iou", "finite")),
        (["--set", "tracking.failure_iou=much"], ("failure_iou", "a number")),
        (["--set", "tracking.failure_iou=["], ("failure_iou",)),
        (["--set", "tracking.failure_iou=2020-13-45"], ("failure_iou",)),
        (["--set", f"tracking.failure_iou={'9' * 5000}"], ("failure_iou",)),
        (["--set", "tracking.failure_iou"], ("NAME=VALUE",)),
        (["--set", "tracking.luck=1"], ("luck", "failure_iou")),
        (["--set", "luck=1"], ("luck", "etd_ros parameters")),
        (["--config", "missing.yaml"], ("missing.yaml",)),
    ],
)
def test_an_unknown_method_or_parameter_and_a_value_out_of_range_are_refused(capsys, place, bag, options, words):
    assert_refused(capsys, place, track(bag, *options), *words)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        ("a: [", "not YAML"),
        ("tracking: 1", "ros__parameters"),
        ("/**:\n  ros__parameters:\n    tracking:\n      failure_iou: 7.0\n", "failure_iou"),
        ("/**:\n  ros__parameters:\n    tracking:\n      luck: 7.0\n", "luck"),
    ],
)
def test_a_wrong_parameter_file_is_refused(capsys, place, bag, tmp_path, content, word):
    config = tmp_path / "config.yaml"
    config.write_text(content)
    assert_refused(capsys, place, track(bag, "--config", str(config)), word)


def test_simulate_refuses_a_negative_seed(capsys, place):
    assert_refused(capsys, place, ["simulate", "demo", "--output", "bag", "--seed", "-1"], "--seed -1")


@pytest.mark.parametrize("force", [[], ["--force"]])
@pytest.mark.parametrize("kind", ["file", "folder", "recorded bag"])
def test_simulate_touches_nothing_that_it_has_not_made(capsys, place, force, kind):
    output = place / "there"
    if kind == "file":
        output.write_text("mine")
    elif kind == "folder":
        output.mkdir()
        (output / "mine").touch()
    else:
        command_bags.sound(output)
    assert_refused(capsys, place, ["simulate", "demo", "--output", str(output), *force], "there", "exists")


def test_simulate_refuses_an_output_that_cannot_be_written(capsys, place):
    (place / "file").touch()
    assert_refused(capsys, place, ["simulate", "demo", "--output", "file/bag"], "file/bag")


@pytest.mark.parametrize("rate", ["0", "-1", "nan", "1e9"])
def test_replay_refuses_a_rate_out_of_range(capsys, place, bag, rate):
    assert_refused(capsys, place, ["replay", bag, f"--rate={rate}"], "--rate")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ("COMMAND", "python -m etd_ros --help")),
        (["trak"], ("'trak'", "'track'", "python -m etd_ros --help")),
        (["track"], ("--output", "python -m etd_ros track --help")),
        (["track", "a", "--output", "b", "--size", "big"], ("--size", "640x480", "python -m etd_ros track --help")),
        (["simulate", "nothing"], ("'nothing'", "'trio'", "python -m etd_ros simulate --help")),
    ],
)
def test_words_that_no_command_takes_are_one_line_with_where_to_look(capsys, place, arguments, words):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("etd_ros: ")
    for word in words:
        assert word in line


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["track", "missing.bag", "--target", TARGET, "--output", "tracks.csv"], "missing.bag"),
        (["info", "missing.bag"], "missing.bag"),
        (["replay", "missing.bag"], "missing.bag"),
        (["simulate", "demo", "--output", "bag", "--seed=-3"], "--seed -3"),
        (["demo", "--truth", "missing.csv"], "missing.csv"),
        (["demo", "--recording", "missing.bag"], "missing.bag"),
    ],
)
def test_a_real_process_says_one_line_and_exits_with_2(place, repository, arguments, word):
    process = subprocess.run(
        [sys.executable, "-m", "etd_ros", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, "PYTHONPATH": str(repository)},
    )
    assert process.returncode == 2
    assert process.stdout == ""
    assert process.stderr.count("\n") == 1
    assert word in process.stderr
    assert list(place.iterdir()) == []
