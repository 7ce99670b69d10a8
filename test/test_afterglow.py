"""What is put together for eyes."""

import numpy as np
import pytest

from etd_ros.afterglow import FADE_NS, GONE_NS, Afterglow, LastImage

MS = 1_000_000


def one_pixel(column: int, level: int = 200, width: int = 8) -> np.ndarray:
    data = np.zeros((4, width, 2), np.uint8)
    data[1, column, 0] = level
    return data


def test_earlier_frames_fade_with_time():
    glow = Afterglow()
    glow.take(0, one_pixel(0))
    glow.take(FADE_NS, one_pixel(1))
    shown = glow.frame()
    assert shown[1, 1, 0] == 200
    assert shown[1, 0, 0] == pytest.approx(200 / np.e, abs=1)
    glow.take(GONE_NS + 1, one_pixel(2))
    assert glow.frame()[1, 0, 0] == 0
    assert glow.frame()[1, 2, 0] == 200


def test_what_is_brighter_shows():
    glow = Afterglow()
    glow.take(0, one_pixel(0, 250))
    glow.take(1, one_pixel(0, 100))
    assert glow.frame()[1, 0, 0] == pytest.approx(250, abs=1)


def test_a_frame_is_not_changed_by_those_after_it():
    glow, first = Afterglow(), one_pixel(0)
    glow.take(0, first)
    glow.take(1, one_pixel(1))
    glow.frame()
    assert np.array_equal(first, one_pixel(0))


@pytest.mark.parametrize(("stamp_ns", "width"), [(99 * MS, 8), (100 * MS, 9)])
def test_time_that_goes_back_and_another_size_start_anew(stamp_ns, width):
    glow = Afterglow()
    glow.take(100 * MS, one_pixel(0))
    glow.take(stamp_ns, one_pixel(1, width=width))
    assert np.array_equal(glow.frame(), one_pixel(1, width=width))


def test_the_last_image_stands_for_frames_without_one():
    last, image = LastImage(), np.ones((4, 8), np.uint8)
    last.take(None)
    assert last.at((4, 8)) is None
    last.take(image)
    last.take(None)
    assert last.at((4, 8)) is image
    assert last.at((4, 9)) is None
