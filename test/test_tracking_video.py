"""A video of tracking plays at the pace of what it shows."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.evaluation import TimedBox
from etd_ros.overlay import STATE_COLOURS, TRUTH, OverlayError
from etd_ros.tracking import TargetReport, TargetState
from etd_ros.tracking_video import FPS, tracking_video

WIDTH, HEIGHT = 240, 180
MS = 1_000_000
START_NS = 1_700_000_000_000_000_000


def grey(level: int) -> np.ndarray:
    """An image by which a frame is recognised in the video."""
    return np.full((HEIGHT, WIDTH), level, np.uint8)


def filmed(path, stamps_ms, *, levels=None, reports=(), **options) -> list[np.ndarray]:
    """The pictures of a video of frames at these times."""
    levels = levels or [0] * len(stamps_ms)
    data = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    with tracking_video(path, **options) as video:
        for stamp_ms, level in zip(stamps_ms, levels, strict=True):
            video.add(START_NS + round(stamp_ms * MS), data, tuple(reports), grey(level))
    capture = cv2.VideoCapture(str(path))
    assert capture.get(cv2.CAP_PROP_FPS) == FPS
    pictures = []
    while (answer := capture.read())[0]:
        pictures.append(answer[1])
    capture.release()
    return pictures


def levels_of(pictures) -> list[float]:
    """Brightness of the image, in the middle of the right half."""
    return [float(picture[100:300, 1000:1300].mean()) for picture in pictures]


@pytest.mark.parametrize("interval_ms", [0.5, 4, 33, 90])
@pytest.mark.parametrize("slow", [0.5, 1, 4])
def test_a_second_lasts_as_long_as_it_shall_however_many_frames_it_has(tmp_path, interval_ms, slow):
    stamps_ms = np.arange(0, 500 + interval_ms, interval_ms)
    pictures = filmed(tmp_path / "out.mp4", stamps_ms, slow=slow)
    assert len(pictures) / FPS == pytest.approx(stamps_ms[-1] * 1e-3 * slow, abs=1 / FPS)


def test_each_picture_is_of_the_newest_frame(tmp_path):
    # Pictures are due at 0, 33.3, 66.7 and 100 ms.
    stamps_ms, levels = [0, 30, 34, 60, 100, 101], [40, 80, 120, 160, 200, 250]
    shown = levels_of(filmed(tmp_path / "out.mp4", stamps_ms, levels=levels))
    assert shown == pytest.approx([40, 80, 160, 200], abs=6)


def test_a_fine_frame_lies_over_those_just_before_it_that_fade(tmp_path):
    path = tmp_path / "out.mp4"
    with tracking_video(path) as video:
        for index, stamp_ms in enumerate((0, 4, 8, 33.4)):
            data = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
            data[20 * index + 10 : 20 * index + 20, 40:60, 0] = 255
            video.add(round(stamp_ms * MS), data, ())
    capture = cv2.VideoCapture(str(path))
    picture = capture.read()[1], capture.read()[1]
    at_0, at_8 = ([float(shown[120 * i + 70 : 120 * i + 110, 250:350].mean()) for i in range(4)] for shown in picture)
    assert at_0[0] > 150 > 40 > max(at_0[1:])
    assert at_8[2] > at_8[1] + 30 > at_8[0] + 60
    assert at_8[3] < 40


def test_long_gaps_and_steps_back_in_time_are_left_out(tmp_path):
    for name, stamps_ms in (("gap.mp4", [0, 100, 3_600_000, 3_600_100]), ("back.mp4", [5000, 5100, 0, 100])):
        shown = levels_of(filmed(tmp_path / name, stamps_ms, levels=[40, 80, 120, 160]))
        assert shown == pytest.approx([40, 40, 40, 80, 120, 120, 120, 160], abs=6)


def test_truth_is_drawn_at_the_time_of_the_frame(tmp_path):
    truth = {"cup": [TimedBox(START_NS, Box(20, 40, 40, 40)), TimedBox(START_NS + 200 * MS, Box(120, 40, 40, 40))]}
    pictures = filmed(tmp_path / "out.mp4", [0, 100, 200, 300], truth=truth)
    columns = []
    for picture in pictures:
        row = np.abs(picture[180, :720].astype(int) - TRUTH).max(axis=1)
        columns.append(np.flatnonzero(row < 70).tolist())
    assert columns[0][0] == pytest.approx(60, abs=2)
    assert columns[3][0] == pytest.approx(210, abs=2)
    assert columns[6][0] == pytest.approx(360, abs=2)
    assert columns[9] == []


def test_boxes_and_the_moment_of_recovery_are_drawn(tmp_path):
    colour = np.array(STATE_COLOURS[TargetState.TRACKING])
    box = Box(80, 60, 40, 40)
    missed = TargetReport("cup", TargetState.RECOVERING, None, 0.0)
    found = TargetReport("cup", TargetState.TRACKING, box, 1.0)
    data = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    path = tmp_path / "out.mp4"
    with tracking_video(path) as video:
        for index in range(50):
            report = missed if index < 10 else found
            video.add(START_NS + index * 10 * MS, data, (report,))
    capture = cv2.VideoCapture(str(path))
    pictures = [capture.read()[1] for _ in range(15)]
    inside = [picture[380:460, 520:600].mean() for picture in pictures]
    edge = [np.abs(picture[400:460, 480].astype(int) - colour).mean() < 60 for picture in pictures]
    assert edge == [False] * 3 + [True] * 12
    assert inside[3] > inside[0] + 10
    assert inside[-1] == pytest.approx(inside[0], abs=2)


@pytest.mark.parametrize("slow", [0, -1, 1e9, float("nan")])
def test_other_paces_are_refused(tmp_path, slow):
    with pytest.raises(OverlayError, match="times as slow"), tracking_video(tmp_path / "out.mp4", slow=slow):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_video_that_fails_leaves_nothing(tmp_path):
    def film_and_fail():
        with tracking_video(tmp_path / "out.mp4") as video:
            video.add(0, np.zeros((HEIGHT, WIDTH, 2), np.uint8), ())
            video.add(10**9, np.zeros((HEIGHT, WIDTH, 2), np.uint8), ())
            raise KeyError

    with pytest.raises(KeyError):
        film_and_fail()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("size", [(240, 180), (346, 260), (640, 480), (1280, 720)])
def test_pictures_are_about_as_wide_for_every_sensor(tmp_path, size):
    path = tmp_path / "out.mp4"
    with tracking_video(path) as video:
        video.add(0, np.zeros((size[1], size[0], 2), np.uint8), (), np.zeros(size[::-1], np.uint8))
    width = cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FRAME_WIDTH)
    assert 1280 <= width <= 1440


def test_pictures_replace_one_another_where_frames_fade(tmp_path):
    with tracking_video(tmp_path / "out.mp4") as video:
        for stamp_ms, level in ((0, 250), (32, 250), (33, 60), (34, 0)):
            video.add(START_NS + stamp_ms * MS, grey(level), ())
    capture = cv2.VideoCapture(str(tmp_path / "out.mp4"))
    levels = [float(capture.read()[1][100:300, 300:600].mean()) for _ in range(2)]
    assert levels == pytest.approx([250, 60], abs=6)
