"""`calibrate`: the interval of a recording, as text, YAML and pictures."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import command_bags
import cv2
import numpy as np
import pytest
import yaml

from etd_ros.cli import main
from etd_ros.commands.calibrate import text_histogram
from etd_ros.conversion import PAPER_INTERVAL, AtsltdConverter
from etd_ros.conversion.calibration import calibrate
from etd_ros.evaluation import read_tracks
from etd_ros.events import Events
from etd_ros.recordings import open_recording
from etd_ros.settings import read_parameter_file, settings_from_mapping
from msg_adapters import encode_event_packet


def printed_interval(text: str) -> list[float]:
    return [float(number) for number in re.search(r"\[alpha, beta\] = \[([\d.]+), ([\d.]+)\]", text).groups()]


def test_the_file_holds_the_interval_that_is_printed(capsys, demo, place):
    assert main(["calibrate", str(demo), "--samples", "40", "--output", "sensor.yaml"]) == 0
    printed = capsys.readouterr().out
    parameters = yaml.safe_load((place / "sensor.yaml").read_text())["/**"]["ros__parameters"]
    alpha, beta = parameters["atsltd"]["nzge_interval"]
    assert printed_interval(printed) == [alpha, beta]
    assert 0.05 < alpha < beta < 0.15
    assert "frames with clear contours: 40 (40 asked for)" in printed
    settings = settings_from_mapping(read_parameter_file(place / "sensor.yaml"))
    assert settings.atsltd.nzge_interval == (alpha, beta)
    assert list(place.iterdir()) == [place / "sensor.yaml"]


def test_track_ends_its_frames_as_the_file_says(demo, place):
    assert main(["calibrate", str(demo), "--samples", "20", "--output", "sensor.yaml"]) == 0
    command = ["track", str(demo), "--target", "ball:30,20,40,40", "--output", "tracks.csv", "--method", "etd-nr"]
    assert main([*command, "--config", "sensor.yaml"]) == 0
    config = settings_from_mapping(read_parameter_file(place / "sensor.yaml")).atsltd
    with open_recording(demo) as recording:
        converter = AtsltdConverter(recording.width, recording.height, config)
        stamps = [frame.stamp_ns for batch in recording.streams() for frame in converter.convert(batch.events)]
    assert config.nzge_interval != PAPER_INTERVAL
    assert [row.stamp_ns for row in read_tracks(place / "tracks.csv")["ball"]] == stamps


def test_cells_and_noise_filter_are_written_beside_the_interval_that_holds_for_them(demo, place):
    settings = ["--set", "atsltd.cell_size=8", "--set", "noise_filter.window_s=0.005"]
    assert main(["calibrate", str(demo), "--samples", "30", "--output", "cells.yaml", *settings]) == 0
    assert main(["calibrate", str(demo), "--samples", "30", "--output", "plain.yaml"]) == 0
    cells, plain = (read_parameter_file(place / name) for name in ("cells.yaml", "plain.yaml"))
    assert (cells["atsltd.cell_size"], cells["noise_filter.window_s"]) == (8, 0.005)
    assert (plain["atsltd.cell_size"], plain["noise_filter.window_s"]) == (4, 0.0)
    assert cells["atsltd.nzge_interval"] != plain["atsltd.nzge_interval"]


def test_a_file_of_parameters_is_heeded(demo, place):
    (place / "given.yaml").write_text("/**: {ros__parameters: {atsltd: {log_base: 16.0}}}")
    command = ["calibrate", str(demo), "--samples", "20", "--config", "given.yaml", "--output", "made.yaml"]
    assert main(command) == 0
    assert read_parameter_file(place / "made.yaml")["atsltd.log_base"] == 16.0


def test_less_significance_widens_the_interval(capsys, demo):
    widths = []
    for significance in ("0.5", "0.001"):
        assert main(["calibrate", str(demo), "--samples", "20", "--significance", significance]) == 0
        alpha, beta = printed_interval(capsys.readouterr().out)
        widths.append(beta - alpha)
    assert widths[1] > 2 * widths[0]


def test_the_sheet_and_the_histogram_are_pictures(demo, place):
    command = ["calibrate", str(demo), "--samples", "25", "--sheet", "sheet.png", "--histogram", "histogram.png"]
    assert main(command) == 0
    sheet, histogram = (cv2.imread(str(place / name)) for name in ("sheet.png", "histogram.png"))
    assert sheet.shape[1] > 1000
    assert sheet.shape[0] > 5 * 150
    assert np.ptp(sheet) > 200
    assert np.ptp(histogram) > 200
    assert sorted(path.name for path in place.iterdir()) == ["histogram.png", "sheet.png"]


def test_the_text_histogram_counts_every_frame_and_marks_the_interval():
    calibration = calibrate(np.random.default_rng(1).normal(0.09, 0.01, 200))
    lines = text_histogram(calibration).splitlines()
    assert sum(int(line.split()[-1]) for line in lines) == 200
    marked = [float(line.split()[0]) for line in lines if "|" in line]
    width = float(lines[1].split()[0]) - float(lines[0].split()[0])
    assert marked
    assert all(calibration.interval[0] - 1.01 * width <= low <= calibration.interval[1] for low in marked)


def test_frames_that_are_all_equal_have_a_histogram():
    assert text_histogram(calibrate(np.full(10, 0.09))).count(" 10\n") == 1


def refused(capsys, place: Path, *arguments: str) -> str:
    before = sorted(place.rglob("*"))
    assert main(["calibrate", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("etd_ros: ")
    assert captured.err.count("\n") == 1
    assert sorted(place.rglob("*")) == before, "something was left behind"
    return captured.err


def test_noise_without_contours_is_refused_by_name(capsys, place, tmp_path):
    bag = command_bags.sound(tmp_path / "noise_bag")
    line = refused(capsys, place, str(bag), "--output", "a.yaml", "--sheet", "a.png", "--histogram", "b.png")
    assert "noise_bag" in line
    assert "0 frames" in line
    assert "noise_filter.window_s" in line


def test_an_interval_that_the_nodes_would_refuse_is_not_written(capsys, place, demo):
    line = refused(capsys, place, str(demo), "--samples", "20", "--significance", "1e-300", "--output", "a.yaml")
    assert "--significance 1e-300" in line
    assert "nzge_interval" in line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--samples", "0"), "--samples 0"),
        (("--samples", "9"), "needs 10 frames"),
        (("--significance", "0"), "--significance 0"),
        (("--significance", "1.5"), "--significance 1.5"),
        (("--significance", "nan"), "--significance nan"),
        (("--set", "atsltd.cell_size=1"), "cell_size"),
        (("--output", "."), "a folder"),
        (("--sheet", "missing/sheet.png"), "missing/sheet.png"),
        (("--sheet", "sheet.jpg"), "sheet.jpg: pictures are PNG files"),
        (("--sheet", "sheet.png", "--histogram", "histogram"), "histogram: pictures are PNG files"),
        (("--output", "a", "--sheet", "a"), "two outputs"),
    ],
)
def test_a_wrong_option_is_refused_before_the_recording_is_read(capsys, place, arguments, words):
    assert words in refused(capsys, place, "no_such_recording.bag", *arguments)


def test_a_missing_recording_is_refused(capsys, place):
    assert "no_such_recording.bag" in refused(capsys, place, "no_such_recording.bag", "--output", "a.yaml")


def test_a_histogram_without_matplotlib_is_refused(capsys, place, demo, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    line = refused(capsys, place, str(demo), "--histogram", "histogram.png")
    assert "python3-matplotlib" in line


def test_nothing_but_a_histogram_needs_matplotlib(capsys, place, demo, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    command = ["calibrate", str(demo), "--samples", "20", "--sheet", "sheet.png", "--output", "sensor.yaml"]
    assert main(command) == 0


def test_a_recording_in_which_the_sensor_size_changes_has_a_sheet(demo, place, tmp_path):
    with open_recording(demo) as recording:
        events = list(recording.events())[:150]
    larger = [Events(batch.t + 2 * 10**9, batch.x, batch.y, batch.p, 300, 180) for batch in events]
    packets = [
        encode_event_packet(batch, stamp_ns=int(batch.t[-1]), frame_id="cam", seq=seq)
        for seq, batch in enumerate([*events, *larger])
    ]
    bag = command_bags.write_bag(tmp_path / "two_sizes", packets)
    assert main(["calibrate", str(bag), "--samples", "20", "--sheet", "sheet.png"]) == 0
    assert np.ptp(cv2.imread(str(place / "sheet.png"))) > 200
