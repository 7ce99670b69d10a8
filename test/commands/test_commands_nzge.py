"""`nzge`: the information in frames over time."""

from __future__ import annotations

import csv
import re
import sys
from pathlib import Path

import command_bags
import cv2
import numpy as np
import pytest

from etd_ros.cli import main
from etd_ros.commands.nzge import frames_with_events, growth
from etd_ros.conversion import AtsltdConfig, AtsltdConverter, FixedWindowConverter, FrameEnd
from etd_ros.conversion.atsltd import PAPER_INTERVAL
from etd_ros.conversion.calibration import frame_data
from etd_ros.engine import FrameSource
from etd_ros.events import Events
from etd_ros.recordings import open_recording
from etd_ros.settings import Settings, settings_from_mapping
from etd_ros.stream import Restart, StreamBatch


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def demo_frames(demo: Path, conversion: str, settings: Settings, limit: int = 60) -> list:
    with open_recording(demo) as recording:
        pairs = frames_with_events(recording.streams(), conversion, settings)
        return [next(pairs) for _ in range(limit)]


@pytest.mark.parametrize("conversion", ["atsltd", "fixed_window", "fixed_count"])
def test_each_frame_comes_with_its_events(demo, conversion):
    for frame, events in demo_frames(demo, conversion, Settings()):
        assert len(events) == frame.events
        if frame.end in (FrameEnd.NZGE, FrameEnd.COUNT):
            assert int(events.t[-1]) == frame.stamp_ns
            np.testing.assert_array_equal(frame_data(events, frame.start_ns), frame.data)


def test_a_restarted_stream_forgets_the_events_of_its_unfinished_frame():
    rng = np.random.default_rng(0)
    x, y = (rng.integers(0, size, 3000, np.uint16) for size in (40, 30))
    t = np.arange(3000, dtype=np.int64) * 10_000
    events = Events(t, x, y, rng.integers(0, 2, 3000, np.uint8), 40, 30)
    settings = settings_from_mapping({"fixed_count.count": 1000})
    batches = [StreamBatch(events[:1500], None), StreamBatch(events, Restart.TIME_STEP_BACK)]
    starts = [int(held.t[0]) for _, held in frames_with_events(batches, "fixed_count", settings)]
    assert starts == [0, 0, 10_000_000, 20_000_000]


def test_the_points_of_a_frame_grow_to_its_end(demo):
    for frame, events in demo_frames(demo, "atsltd", Settings(), 10):
        points = growth(frame, events, 8, Settings())
        counts = [point.events for point in points]
        assert len(points) == 7
        assert counts == sorted(set(counts))
        assert counts[-1] < frame.events
        assert 0 < points[0].nzge < points[-1].nzge < frame.nzge
        assert all(point.stamp_ns <= frame.stamp_ns for point in points)


def test_the_curve_holds_every_frames_end(capsys, demo, place):
    assert main(["nzge", str(demo), "--points", "3", "--output", "curve.csv"]) == 0
    rows = rows_of(place / "curve.csv")
    ends = [row for row in rows if row["end"]]
    with open_recording(demo) as recording:
        converter = AtsltdConverter(recording.width, recording.height)
        frames = [frame for batch in recording.streams() for frame in converter.convert(batch.events)]
    assert [int(row["stamp_ns"]) for row in ends] == [frame.stamp_ns for frame in frames]
    assert [float(row["nzge"]) for row in ends] == pytest.approx([frame.nzge for frame in frames], abs=1e-6)
    assert [int(row["frame"]) for row in ends] == list(range(len(frames)))
    assert len(rows) == 3 * len(frames)
    assert f"frames: {len(frames)} ({len(frames)} by nzge)" in capsys.readouterr().out
    assert list(place.iterdir()) == [place / "curve.csv"]


def test_frames_of_other_kinds_have_curves_too(capsys, demo, place):
    settings = ["--conversion", "fixed_window", "--set", "fixed_window.window_s=0.02"]
    assert main(["nzge", str(demo), "--points", "1", "--output", "curve.csv", *settings]) == 0
    with open_recording(demo) as recording:
        converter = FixedWindowConverter(
            recording.width, recording.height, settings_from_mapping({"fixed_window.window_s": 0.02}).fixed_window
        )
        frames = [frame for batch in recording.streams() for frame in converter.convert(batch.events)]
    assert [row["end"] for row in rows_of(place / "curve.csv")] == ["window"] * len(frames)
    assert f"{len(frames)} by window" in capsys.readouterr().out


def test_fine_frames_are_held_against_their_own_interval(capsys, demo):
    assert main(["nzge", str(demo), "--conversion", "atsltd_fine"]) == 0
    low, high = PAPER_INTERVAL
    share = AtsltdConfig().fine_share
    assert f"[alpha, beta] = [{share * low:.4f}, {share * high:.4f}]: 0 below" in capsys.readouterr().out


def test_noise_is_filtered_once_and_before_the_frames(capsys, demo):
    counts = []
    for window_s in ("0.0", "0.002"):
        assert main(["nzge", str(demo), "--set", f"noise_filter.window_s={window_s}"]) == 0
        counts.append(int(re.search(r"frames: (\d+)", capsys.readouterr().out).group(1)))
    settings = settings_from_mapping({"noise_filter.window_s": 0.002})
    with open_recording(demo) as recording:
        source = FrameSource("atsltd", recording.width, recording.height, settings)
        assert counts[1] == sum(1 for batch in recording.streams() for _ in source.frames(batch.events))
    assert counts[0] != counts[1]


def test_the_plot_is_a_picture(demo, place):
    assert main(["nzge", str(demo), "--plot", "curve.png", "--frames", "5", "--from", "1"]) == 0
    assert np.ptp(cv2.imread(str(place / "curve.png"))) > 200
    assert list(place.iterdir()) == [place / "curve.png"]


def test_a_plot_from_beyond_the_recordings_end_shows_the_frames_ends_alone(demo, place):
    assert main(["nzge", str(demo), "--plot", "curve.png", "--from", "1000"]) == 0
    assert (place / "curve.png").is_file()


def refused(capsys, place: Path, *arguments: str) -> str:
    before = sorted(place.rglob("*"))
    assert main(["nzge", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("etd_ros: ")
    assert captured.err.count("\n") == 1
    assert sorted(place.rglob("*")) == before, "something was left behind"
    return captured.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--points", "0"), "--points 0"),
        (("--frames", "0"), "--frames 0"),
        (("--from", "nan"), "--from nan"),
        (("--plot", "."), "a folder"),
        (("--plot", "curve"), "curve: pictures are PNG files"),
        (("--output", "missing/curve.csv"), "missing/curve.csv"),
    ],
)
def test_a_wrong_option_is_refused_before_the_recording_is_read(capsys, place, arguments, words):
    assert words in refused(capsys, place, "no_such_recording.bag", *arguments)


def test_a_recording_without_a_whole_frame_is_refused(capsys, place, tmp_path):
    bag = command_bags.sound(tmp_path / "short_bag")
    line = refused(capsys, place, str(bag), "--output", "a.csv", "--set", "atsltd.nzge_interval=[0.9, 1.0]")
    assert "short_bag" in line
    assert "no frame" in line


def test_a_plot_without_matplotlib_is_refused(capsys, place, demo, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert "python3-matplotlib" in refused(capsys, place, str(demo), "--plot", "curve.png")
