"""The command `track` with compared systems."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import system_recordings as simulated

from etd_ros.cli import main
from etd_ros.evaluation import read_tracks
from etd_ros.recordings import open_recording
from etd_ros.systems.running import run_system


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The simulated recording as the Event Camera Dataset has its own."""
    place = tmp_path_factory.mktemp("recording")
    with (place / "events.txt").open("w") as file:
        for batch in simulated.recording().streams():
            events = batch.events
            for t, x, y, p in zip(events.t.tolist(), events.x, events.y, events.p, strict=True):
                file.write(f"{t // 10**9}.{t % 10**9:09d} {x} {y} {p}\n")
    with (place / "images.txt").open("w") as file:
        for number, image in enumerate(simulated.recording().images()):
            cv2.imwrite(str(place / f"{number}.png"), image.data)
            file.write(f"{image.stamp_ns // 10**9}.{image.stamp_ns % 10**9:09d} {number}.png\n")
    return place


@pytest.fixture(scope="module")
def without_video(folder, tmp_path_factory):
    place = tmp_path_factory.mktemp("without_video")
    (place / "events.txt").write_bytes((folder / "events.txt").read_bytes())
    return place


@pytest.fixture
def boxes(tmp_path):
    """Truth of both targets, the first rows of which they start from."""
    rows = ["target,stamp_ns,x,y,w,h"]
    for name in simulated.NAMES:
        for time_s in np.arange(0.1, simulated.DURATION_S, 0.02):
            box = simulated.scene().box(name, time_s)
            rows.append(f"{name},{simulated.stamp_ns(time_s)},{box.x},{box.y},{box.w},{box.h}")
    file = tmp_path / "boxes.csv"
    file.write_text("\n".join(rows) + "\n")
    return file


def command(recording, boxes, *options: str) -> list[str]:
    size = f"{simulated.WIDTH}x{simulated.HEIGHT}"
    return ["track", str(recording), "--size", size, "--targets", str(boxes), *options]


@pytest.mark.parametrize("name", ["kcf", "kcf-reconstruction", "e-ms"])
def test_compared_systems_write_the_tracks_that_they_make(folder, boxes, tmp_path, name):
    output = tmp_path / "tracks.csv"
    assert main(command(folder, boxes, "--method", name, "--output", str(output))) == 0
    with open_recording(folder, size=(simulated.WIDTH, simulated.HEIGHT)) as recording:
        steps = list(run_system(name, recording, [simulated.start(target) for target in simulated.NAMES]))
    written = read_tracks(output)
    for number, target in enumerate(simulated.NAMES):
        expected = [(step.stamp_ns, step.reports[number].box, step.reports[number].state.value) for step in steps]
        assert [(row.stamp_ns, row.box, row.state) for row in written[target]] == expected


@pytest.mark.parametrize("name", ["kcf", "kcf-reconstruction", "e-ms"])
def test_the_video_shows_what_the_system_saw_and_the_plot_the_overlap(folder, boxes, tmp_path, name):
    video, plot = tmp_path / "video.mp4", tmp_path / "plot.png"
    options = ("--method", name, "--output", str(tmp_path / "tracks.csv"), "--video", str(video), "--plot", str(plot))
    assert main(command(folder, boxes, *options)) == 0
    assert cv2.imread(str(plot)) is not None
    capture = cv2.VideoCapture(str(video))
    capture.set(cv2.CAP_PROP_POS_FRAMES, 4)
    shown = capture.read()[1]
    scale = shown.shape[1] / simulated.WIDTH
    # What lies between the two things: grey wall in pictures, nothing but ground where only events are shown.
    x, y = (round(scale * place) for place in (110, 20))
    middle = shown[y - 8 : y + 8, x - 8 : x + 8].mean()
    assert (middle > 60) == (name != "e-ms")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--auto"], "'kcf' starts from boxes only: give --targets or --target instead of --auto"),
        (["--auto", "--click", "a:10,10"], "instead of --auto and --click"),
        (["--proposals", "--video", "video.mp4"], "nothing to show for --proposals"),
        (["--rerun", "log.rrd"], "nothing to show for --rerun"),
    ],
)
def test_what_only_our_methods_offer_is_refused_for_others(folder, boxes, place, capsys, options, words):
    arguments = command(folder, boxes, "--method", "kcf", "--output", "tracks.csv", *options)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert list(place.iterdir()) == []


def test_a_video_system_without_video_is_one_line_and_leaves_nothing_behind(without_video, boxes, place, capsys):
    assert main(command(without_video, boxes, "--method", "kcf", "--output", "tracks.csv")) == 2
    error = capsys.readouterr().err
    assert "'kcf' needs video" in error
    assert error.count("\n") == 1
    assert list(place.iterdir()) == []
