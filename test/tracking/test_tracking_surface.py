"""Frames are read back into the times of their events."""

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.surface import TimeSurface

MS = 1_000_000


@pytest.mark.parametrize(("start_ns", "age_ms"), [(100 * MS, 2.0), (None, 41.9)])
def test_an_events_age_follows_from_where_its_frame_starts(start_ns, age_ms):
    surface = TimeSurface(16, 12)
    surface.take(20 * MS, np.zeros((12, 16, 2), np.uint8))
    data = np.zeros((12, 16, 2), np.uint8)
    data[5, 7, 1] = 128
    surface.take(104 * MS, data, start_ns)
    window = surface.window(Box(0, 0, 16, 12), 0)
    assert surface.keep(window) == 1
    points, count = surface.points(window, 0.1)
    assert count == 1
    assert points[0, 2] * 1e3 == pytest.approx(age_ms, abs=0.5)


def test_a_frames_newest_events_are_told_without_keeping_them():
    surface = TimeSurface(16, 12)
    data = np.zeros((12, 16, 2), np.uint8)
    data[5, 7, 1], data[5, 12, 0], data[2, 3, 0] = 255, 51, 255
    surface.take(104 * MS, data, 94 * MS)
    points, count = surface.newest(surface.window(Box(5, 4, 9, 3), 0))
    np.testing.assert_allclose(points[:count], [[7.5, 5.5, 0, -1], [12.5, 5.5, 0.008, 1]], atol=1e-6)
    assert surface.points(surface.window(Box(0, 0, 16, 12), 0), 1.0)[1] == 0


def test_events_beside_all_windows_are_known_where_all_is_kept():
    surface, window = TimeSurface(16, 12), (4, 8, 6, 10)
    data = np.zeros((12, 16, 2), np.uint8)
    data[5, 7, 1], data[1, 2, 0] = 255, 255
    for stamp_ms, keeps_all, known in ((10, False, 1), (20, True, 2)):
        surface.keeps_all = keeps_all
        surface.take(stamp_ms * MS, data, (stamp_ms - 10) * MS)
        assert surface.keep(window) == 1
        surface.keep_too(window)
        assert surface.points((0, 12, 0, 16), 0.005)[1] == known


def test_light_that_changes_everywhere_is_not_kept_with_all():
    surface = TimeSurface(16, 12)
    surface.keeps_all = True
    flash = np.zeros((12, 16, 2), np.uint8)
    flash[:, :, 0] = 255
    surface.take(10 * MS, flash)
    assert surface.is_flash
    assert surface.points((0, 12, 0, 16), 1.0)[1] == 0


def test_what_has_fired_since_it_was_asked_last_is_counted_where_all_is_kept():
    surface, contours = TimeSurface(64, 48), Contours(Box(20, 10, 20, 20), 0, ContourConfig())
    surface.keeps_all = True
    counts = {}
    for frame, is_asked in enumerate((False, True, False, False, True), 1):
        data = np.zeros((48, 64, 2), np.uint8)
        data[15:20, 25 + frame, 0] = 255
        surface.take(frame * MS, data, (frame - 1) * MS)
        if is_asked:
            counts[frame] = contours.keep(surface)
    assert counts == {2: 5, 5: 15}, "what came before it was there is not its own"
