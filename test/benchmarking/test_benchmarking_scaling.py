"""The curves of speed against rate, size, texture and messages."""

import builtins

import cv2
import numpy as np
import pytest

from etd_ros.benchmarking import scaling, scaling_png
from etd_ros.benchmarking.scaling import PANELS, PARTS, Setting
from etd_ros.cli import main


@pytest.fixture(scope="module")
def points():
    return list(scaling(events=2000, rounds=1))


def test_every_part_is_measured_at_every_place(points):
    measured = {(point.axis, point.part, point.place) for point in points}
    assert measured == {(panel.axis, part, place) for panel in PANELS for part in PARTS for place in panel.settings}
    assert all(point.mev_per_s > 0 for point in points)


def test_a_place_varies_what_its_axis_says():
    rate, size, share, length = (list(panel.settings.items()) for panel in PANELS)
    assert all(setting == Setting(rate=place * 1e6) for place, setting in rate)
    assert all(setting == Setting(size=setting.size) and np.prod(setting.size) == place for place, setting in size)
    assert all(setting == Setting(active_share=place / 100) for place, setting in share)
    assert all(setting == Setting(message_events=place) for place, setting in length)
    assert max(len(events) for events in Setting(message_events=100).messages(1000)) == 100


def test_the_plot_is_a_picture(points):
    picture = cv2.imdecode(np.frombuffer(scaling_png(points), np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape[0] > 300
    assert picture.std() > 10


def test_without_matplotlib_nothing_is_measured(tmp_path, monkeypatch, capsys):
    original = builtins.__import__

    def without_matplotlib(name, *rest, **more):
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return original(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without_matplotlib)
    assert main(["benchmark", "--scaling", str(tmp_path / "plot.png")]) == 2
    assert "plots need Matplotlib" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
