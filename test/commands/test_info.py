"""The command `info`: what a recording holds, as lines and as JSON."""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

import pytest

from etd_ros.commands import info
from etd_ros.recordings import RecordingError

DATA = Path(os.environ.get("ETD_DATA", Path(__file__).parents[3] / "shared" / "data"))
DRIVERS = DATA / "drivers"
CHECKSUMS = json.loads((DRIVERS / "checksums.json").read_text())
CONTAINERS = [
    ("evt3_640x480", "evt3_640x480"),
    ("evt3_640x480", "evt3_640x480/test_events_1.db3"),
    ("evt3_640x480", "evt3_640x480_ros1.bag"),
    ("libcaer_cmp_346x260", "libcaer_cmp_346x260"),
    ("libcaer_cmp_346x260", "libcaer_cmp_346x260/test_events_2_0.mcap"),
    ("mono_1280x720", "mono_1280x720"),
    ("mono_1280x720", "mono_1280x720/test_data_mono_cd_0.db3"),
]


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    info.add(parser.add_subparsers())
    options = parser.parse_args(["info", *arguments])
    return int(options.run(options))


@pytest.mark.parametrize(("name", "container"), CONTAINERS)
def test_checksums_equal_the_publishers_own_whatever_the_container(name, container, capsys):
    assert run(str(DRIVERS / container), "--checksums", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert {field: report[field] for field in CHECKSUMS[name]} == CHECKSUMS[name]


def test_lines_tell_the_sensor_the_counts_and_the_topics(capsys):
    assert run(str(DATA / "slider_depth" / "slider_depth.bag")) == 0
    output = capsys.readouterr().out
    assert "240x180" in output
    assert "1078541" in output
    assert "/dvs/events (dvs_msgs/msg/EventArray, 102 messages)" in output
    assert "sum_x" not in output


def test_duration_and_rate_are_those_of_the_events(capsys):
    run(str(DATA / "traffic" / "traffic.aedat4"), "--json")
    report = json.loads(capsys.readouterr().out)
    assert report["duration_s"] == pytest.approx(2.359945)
    assert report["rate_events_per_s"] == pytest.approx(78830 / 2.359945)


def test_a_size_can_be_given(tmp_path, capsys):
    (tmp_path / "events.txt").write_text("0.1 600 400 1\n")
    assert run(str(tmp_path), "--size", "640x480", "--json") == 0
    assert json.loads(capsys.readouterr().out)["width"] == 640


@pytest.mark.parametrize("size", ["640", "640x", "ax3", "-1x3"])
def test_a_size_that_is_none_is_refused(size, capsys):
    with pytest.raises(SystemExit) as caught:
        run("recording", f"--size={size}")
    assert caught.value.code == 2
    assert "WIDTHxHEIGHT" in capsys.readouterr().err


def test_a_recording_that_breaks_off_is_an_error_and_prints_nothing(tmp_path, capsys):
    (tmp_path / "events.txt").write_text("0.1 6 4 1\n0.2 6\n")
    with pytest.raises(RecordingError, match="line 2"):
        run(str(tmp_path))
    assert capsys.readouterr().out == ""
