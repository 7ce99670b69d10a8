"""DaSiamRPN as a tracker: its scoring, its look-alikes, and how far it looks for a target that it has lost."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from recovery_scenes import HEIGHT, WIDTH, picture, texture

from etd_ros.boxes import Box
from etd_ros.recovery import RecoveryConfig, RecoveryError, picture_trackers
from etd_ros.recovery.matching import SIAMRPN_GEOMETRY, Answers
from etd_ros.recovery.picture_trackers import make_siamrpn
from etd_ros.recovery.siamrpn import SiamRpn
from etd_ros.recovery.siamrpn_tracking import (
    BIG,
    COMPACT,
    DISTRACTOR_INTERVAL,
    VOT,
    Scoring,
    SiamRpnTracker,
)

START = Box(100, 80, 40, 30)
SCALE = 127 / math.sqrt((40 + 35) * (30 + 35))
PLAIN = Scoring(
    penalty=0.0, window_influence=0.0, size_rate=1.0, instance_side=271, instance_side_max=831, instance_side_step=56,
    lost_score=0.3, found_score=0.6,
)  # fmt: skip


class Answering:
    """A network that answers with given places (column, row, w, h on the picture, score), whatever the picture.

    The first template is the target's; later ones are those of look-alikes, which answer as `look_alike` says.
    """

    geometry = SIAMRPN_GEOMETRY

    def __init__(self, *places: tuple[float, float, float, float, float], look_alike: float | None = None) -> None:
        self.places, self._look_alike = places, look_alike
        self.windows: list[int] = []
        self.templates: list[tuple[float, float]] = []
        self._last: Box = START

    def template(self, exemplar, size):
        assert exemplar.shape[:2] == (127, 127)
        self.templates.append(size)
        return len(self.templates)

    def match(self, window, templates, distractors=()):
        """Places lie 8 pixels apart; each answer is put where it belongs, its box exactly."""
        side = len(window)
        self.windows.append(side)
        count = (side - 127) // 8 + 1
        boxes = np.ones((len(templates), 4, count, count), np.float32)
        scores = np.zeros((len(templates) + len(distractors), count, count), np.float32)
        for x, y, w, h, score in self.places:
            column, row = ((offset * SCALE) + side / 2 for offset in (x - 120, y - 95))
            at = tuple(int(np.clip(round((place - 63.5) / 8), 0, count - 1)) for place in (row, column))
            boxes[:, :, at[0], at[1]] = column, row, w * SCALE, h * SCALE
            scores[0, at[0], at[1]] = score
            if self._look_alike is not None and (x, y) != (120, 95):
                scores[1:, at[0], at[1]] = self._look_alike
        return Answers(scores, boxes)


def tracker_on(network: Answering, **scoring) -> SiamRpnTracker:
    tracker = SiamRpnTracker(network, PLAIN._replace(**scoring))
    tracker.start(BLANK, START)
    return tracker


BLANK = np.full((HEIGHT, WIDTH), 128, np.uint8)
HERE = (120.0, 95.0, 40.0, 30.0)


def test_the_box_is_that_of_the_likeliest_place():
    network = Answering((*HERE, 0.5), (140.0, 90.0, 44.0, 27.0, 0.9))
    box, score = tracker_on(network).update(BLANK)
    assert score == pytest.approx(0.9)
    # Its place is taken as it is; its size as fast as the score says.
    np.testing.assert_allclose(box.center, (140, 90), atol=1e-3)
    np.testing.assert_allclose((box.w, box.h), (40 + 0.9 * 4, 30 - 0.9 * 3), atol=1e-3)
    assert network.windows == [271]
    np.testing.assert_allclose(network.templates, [(40 * SCALE, 30 * SCALE)])


def test_changes_of_size_and_shape_cost_what_the_paper_says():
    k, w, h = 0.3, 60.0, 25.0
    network = Answering((*HERE, 0.5), (140.0, 90.0, w, h, 0.9))
    padding = (w + h) / 2
    size = math.sqrt((w + padding) * (h + padding)) / math.sqrt((40 + 35) * (30 + 35))
    penalty = math.exp(-(max(size, 1 / size) * (w / h) / (40 / 30) - 1) * k)
    box, _ = tracker_on(network, penalty=k).update(BLANK)
    assert box.w == pytest.approx(40 + penalty * 0.9 * 20, rel=1e-4)
    assert tracker_on(network, penalty=5.0).update(BLANK)[0].center == pytest.approx((120, 95))


def test_the_hanning_window_prefers_what_is_near():
    network = Answering((*HERE, 0.6), (150.0, 95.0, 40.0, 30.0, 0.9))
    assert tracker_on(network).update(BLANK)[0].center[0] > 140
    assert tracker_on(network, window_influence=0.45).update(BLANK)[0].center[0] == pytest.approx(120)


def test_the_search_grows_while_the_target_is_lost_and_is_local_again_when_it_is_found():
    network = Answering((*HERE, 0.2))
    tracker = tracker_on(network)
    answers = [tracker.update(BLANK) for _ in range(12)]
    assert all(box is None and score == pytest.approx(0.2) for box, score in answers)
    # What it takes to see twice the picture's longer side, and no more.
    useful = 271 + 8 * math.ceil((2 * WIDTH * SCALE - 271) / 8)
    assert network.windows == [min(271 + 56 * number, 831, useful) for number in range(12)]
    network.places = ((*HERE, 0.5),)
    assert tracker.update(BLANK)[0] is None
    network.places = ((30.0, 20.0, 40.0, 30.0, 0.7),)
    box, _ = tracker.update(BLANK)
    np.testing.assert_allclose(box.center, (30, 20), atol=1e-3)
    network.places = ((*HERE, 0.4),)
    tracker.update(BLANK)
    assert network.windows[-1] == 271


def test_a_look_alike_that_was_seen_beside_the_target_is_not_taken_for_it():
    beside = (150.0, 95.0, 40.0, 30.0)
    network = Answering((*HERE, 0.8), (*beside, 0.7), look_alike=0.9)
    tracker = tracker_on(network)
    for _ in range(DISTRACTOR_INTERVAL):
        tracker.update(BLANK)
    assert len(network.templates) == 2
    # Without what is known of it, it would be taken now.
    network.places = ((*HERE, 0.6), (*beside, 0.6 + PLAIN.distractor_weight * 0.85))
    assert tracker.update(BLANK)[0].center == pytest.approx((120, 95))
    fresh = tracker_on(Answering(*network.places))
    assert fresh.update(BLANK)[0].center[0] > 140


def test_what_overlaps_the_target_or_is_hardly_like_it_is_no_look_alike():
    network = Answering((*HERE, 0.8), (130.0, 95.0, 40.0, 30.0, 0.7), (180.0, 95.0, 40.0, 30.0, 0.3))
    tracker = tracker_on(network)
    for _ in range(DISTRACTOR_INTERVAL):
        tracker.update(BLANK)
    assert len(network.templates) == 1


def test_size_and_place_stay_on_the_picture():
    tracker = tracker_on(Answering((400.0, -60.0, 900.0, 900.0, 1.0)))
    box, _ = tracker.update(BLANK)
    assert box.center == (WIDTH, 0)
    assert (box.w, box.h) == (WIDTH, HEIGHT)
    box, _ = tracker_on(Answering((120.0, 95.0, 0.01, 0.01, 1.0))).update(BLANK)
    assert (box.w, box.h) == (4, 4)


def test_answers_that_are_no_numbers_are_a_loss():
    network = Answering((*HERE, math.nan))
    assert tracker_on(network).update(BLANK) == (None, 0.0)


def test_the_network_that_ships_follows_a_textured_sprite():
    make = make_siamrpn(RecoveryConfig())
    overlaps = []
    for seed in (1, 2, 3):
        sprite = texture(seed, 40, 36)
        boxes = [Box(30 + 4 * index, 60 + round(10 * math.sin(index / 5)), 40, 36) for index in range(30)]
        tracker = make()
        tracker.start(picture((sprite, boxes[0])), boxes[0])
        for index, box in enumerate(boxes[1:], 1):
            found, _ = tracker.update(picture((sprite, box), seed=index))
            overlaps.append(0.0 if found is None else found.iou(box))
    assert np.mean(overlaps) > 0.6


def test_a_target_that_comes_out_elsewhere_is_found_again():
    sprite, away = texture(2, 40, 36), Box(170, 20, 40, 36)
    tracker = make_siamrpn(RecoveryConfig())()
    tracker.start(picture((sprite, START._replace(x=20))), START._replace(x=20, w=40, h=36))
    assert tracker.update(picture((sprite, Box(20, 80, 40, 36)), seed=1))[0] is not None
    gone = [tracker.update(picture(seed=index))[0] for index in range(2, 12)]
    assert gone == [None] * 10
    answers = [tracker.update(picture((sprite, away), seed=index))[0] for index in range(12, 18)]
    assert answers[-1] is not None
    assert answers[-1].iou(away) > 0.5


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> Path:
    """A published file's names and shapes, random weights."""
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("models") / "SiamRPNVOT.model"
    torch.save(SiamRpn().state_dict(), path)
    return path


def test_a_published_file_serves_a_tracker_with_all_anchors_on_colour_pictures(model):
    config = RecoveryConfig(siamrpn_model=str(model))
    tracker = make_siamrpn(config)()
    image = np.random.default_rng(1).integers(0, 256, (120, 160, 3)).astype(np.uint8)
    tracker.start(image, Box(40, 40, 30, 20))
    box, score = tracker.update(image)
    assert 0 <= score <= 1
    assert box is None or all(np.isfinite(box))
    matcher, scoring = picture_trackers._published(str(model), model.stat().st_mtime_ns)
    assert scoring == VOT
    answers = matcher.match(texture(1, 271, 271), [tracker._template])
    assert answers.scores.shape == (1, 5, 19, 19)
    assert answers.boxes.shape == (1, 4, 5, 19, 19)
    with_distractor = matcher.match(texture(1, 271, 271), [tracker._template], [tracker._template])
    np.testing.assert_array_equal(with_distractor.scores, answers.scores.repeat(2, 0))
    np.testing.assert_array_equal(with_distractor.boxes, answers.boxes)


def test_the_file_of_the_otb_benchmark_is_known_by_its_name(model, tmp_path):
    """Its network is as large as VOT's; the scoring is that of the authors' code."""
    path = tmp_path / "SiamRPNOTB.model"
    path.write_bytes(model.read_bytes())
    _, scoring = picture_trackers._published(str(path), path.stat().st_mtime_ns)
    assert (scoring.size_rate, scoring.window_influence, scoring.penalty) == (0.30, 0.40, 0.22)


def test_files_that_are_not_there_are_told_in_one_line(tmp_path):
    with pytest.raises(RecoveryError, match=r"gone\.model: no readable file; set the parameter recovery.siamrpn_model"):
        make_siamrpn(RecoveryConfig(siamrpn_model=str(tmp_path / "gone.model")))
    with pytest.raises(RecoveryError, match=r"gone\.safetensors: no readable safetensors file"):
        make_siamrpn(RecoveryConfig(compact_model=str(tmp_path / "gone.safetensors")))


def test_windows_have_sides_that_the_networks_take():
    for scoring, first, geometry in ((VOT, 127, 8), (BIG, 127, 8), (COMPACT, 0, 8)):
        for side in (scoring.instance_side, scoring.instance_side_max):
            assert (side - first) % geometry == 0
        assert scoring.instance_side_step % geometry == 0


def test_colour_pictures_are_seen_as_grey_ones_by_the_network_that_ships():
    sprite = texture(1, 40, 36)
    frames = [(picture((sprite, START._replace(x=100 + shift, h=36)))) for shift in (0, 4)]
    answers = []
    for shown in (frames, [np.repeat(frame[..., None], 3, axis=2) for frame in frames]):
        tracker = make_siamrpn(RecoveryConfig())()
        tracker.start(shown[0], START._replace(h=36))
        answers.append(tracker.update(shown[1]))
    assert answers[0][0] is not None
    np.testing.assert_allclose(answers[0][0], answers[1][0], atol=0.1)
