"""KCF and TLD."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import system_recordings as simulated

from etd_ros.boxes import Box
from etd_ros.settings import Settings
from etd_ros.simulation.textures import blobs, smooth_noise
from etd_ros.systems.interface import CompareError
from etd_ros.systems.opencv_trackers import kcf_maker, tld_maker

MAKERS = {"KCF": kcf_maker, "TLD": tld_maker}
LEAST_IOU = {"KCF": 0.95, "TLD": 0.6}


def picture(x: int, y: int) -> np.ndarray:
    """A 30x26 thing at (x, y) before a smooth wall."""
    wall = 0.5 + 0.1 * smooth_noise(np.random.default_rng(1), 100, 140, grain=5.0)
    wall[y : y + 26, x : x + 30] = blobs(np.random.default_rng(2), 26, 30)
    return (wall * 255).clip(0, 255).astype(np.uint8)


@pytest.mark.parametrize("name", MAKERS)
def test_a_patch_that_is_shifted_by_some_pixels_is_found_there(name):
    tracker = MAKERS[name](Settings(), 0)()
    tracker.start(picture(40, 30), Box(40, 30, 30, 26))
    for step in range(1, 8):
        answer = tracker.update(picture(40 + 3 * step, 30 + step))
        assert answer.box is not None
        assert answer.box.iou(Box(40 + 3 * step, 30 + step, 30, 26)) > LEAST_IOU[name]
        assert np.isnan(answer.score)


def test_kcf_says_that_it_has_lost_a_target_that_is_gone():
    tracker = kcf_maker(Settings(), 0)()
    tracker.start(picture(40, 30), Box(40, 30, 30, 26))
    noise = np.random.default_rng(1).integers(0, 255, (100, 140), np.uint8)
    assert tracker.update(noise).box is None


@pytest.mark.parametrize(("name", "least"), [("kcf", 0.7), ("kcf-reconstruction", 0.55), ("tld", 0.4)])
def test_simulated_targets_are_followed(name, least):
    overlaps = simulated.mean_iou(simulated.tracks_of(name, [simulated.start("left"), simulated.start("right")]))
    assert min(overlaps.values()) > least


def test_tld_follows_from_its_seed_whatever_ran_before():
    starts = [simulated.start("left")]
    first, other, again = (
        [row.box for row in simulated.tracks_of("tld", starts, seed=seed)["left"]] for seed in (0, 1, 0)
    )
    assert first == again
    assert first != other


@pytest.mark.parametrize("name", MAKERS)
def test_of_a_box_over_the_border_the_part_in_the_picture_is_followed(name):
    tracker = MAKERS[name](Settings(), 0)()
    tracker.start(picture(0, 30), Box(-10, 30, 40, 26))
    answer = tracker.update(picture(1, 30))
    assert answer.box is not None
    assert answer.box.iou(Box(1, 30, 30, 26)) > LEAST_IOU[name] - 0.1


def test_small_targets_get_boxes_on_the_pictures_own_pixels_from_tld():
    small = [cv2.resize(picture(40 + 2 * step, 30), None, fx=0.5, fy=0.5) for step in range(6)]
    tracker = tld_maker(Settings(), 0)()
    tracker.start(small[0], Box(20, 15, 15, 13))
    for step in range(1, 6):
        answer = tracker.update(small[step])
        assert answer.box is not None
        assert answer.box.iou(Box(20 + step, 15, 15, 13)) > 0.5


def test_targets_too_small_for_tld_are_refused():
    with pytest.raises(CompareError, match="TLD needs 4 pixels a side"):
        tld_maker(Settings(), 0)().start(picture(40, 30), Box(40, 30, 3, 10))


@pytest.mark.parametrize(("name", "owner", "attribute"), [("KCF", cv2, "TrackerKCF_create"), ("TLD", cv2, "legacy")])
def test_an_opencv_without_contrib_modules_is_answered_with_what_to_install(monkeypatch, name, owner, attribute):
    monkeypatch.delattr(owner, attribute)
    with pytest.raises(CompareError, match=f"{name}: OpenCV .*opencv-contrib-python-headless"):
        MAKERS[name](Settings(), 0)
