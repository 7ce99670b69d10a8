"""The network that ships finds a lost target where it comes out again, and nothing where it does not."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from recovery_scenes import HEIGHT, WIDTH, picture, texture

from etd_ros.boxes import Box, iou
from etd_ros.recovery import Found, RecoveryConfig, RecoveryError, compact, make_recovery, making
from etd_ros.recovery.compact import Compact
from etd_ros.recovery.matchers import CompactMatcher, fused
from etd_ros.recovery.matching import COMPACT_GEOMETRY, Answers
from etd_ros.recovery.siamese import SiameseRecovery
from etd_ros.recovery.weights_file import COMPACT, SHIPPED, load_compact, save_compact

START = Box(60, 70, 40, 36)


@pytest.fixture(scope="module")
def make():
    """Makes trackers with the shipped network."""
    return make_recovery(RecoveryConfig(tracker="compact"))


def after_a_loss(make, *sprites, box: Box = START, images: int = 50, **options) -> SiameseRecovery:
    tracker = make()
    image = picture(*sprites, **options)
    for _ in range(images):
        tracker.remember(image, box)
    return tracker


def searched(tracker, last_box: Box, *sprites, images: int = 6, **options) -> list[Found | None]:
    return [tracker.search(picture(*sprites, seed=seed, **options), last_box) for seed in range(1, images + 1)]


def assert_near(found: Found | None, box: Box) -> None:
    assert found is not None
    assert iou(np.array([found.box]), box)[0] > 0.5
    assert 0 < found.score <= 1


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_target_that_moved_is_found_when_it_comes_out(make, seed):
    sprite = texture(seed, 40, 36)
    tracker = after_a_loss(make, (sprite, START))
    assert searched(tracker, START) == [None] * 6
    moved = START._replace(x=100, y=76)
    assert_near(searched(tracker, START, (sprite, moved))[-1], moved)


def test_what_is_seen_once_is_a_lead_until_it_is_gone(make):
    sprite = texture(1, 40, 36)
    tracker = after_a_loss(make, (sprite, START))
    assert not tracker.has_lead
    assert searched(tracker, START, (sprite, START._replace(x=100)), images=1) == [None]
    assert tracker.has_lead
    searched(tracker, START, images=1)
    assert not tracker.has_lead


def test_a_watch_tells_at_once_where_the_target_is_if_it_is_surely_elsewhere(make):
    sprite = texture(1, 40, 36)
    watch = make().watch()
    for _ in range(4):
        watch.remember(picture((sprite, START)), START)
    moved = START._replace(x=100)
    assert_near(watch.search(picture((sprite, moved), seed=1), START), moved)
    assert watch.search(picture(seed=2), START) is None


def test_a_watch_looks_round_the_box_that_is_followed_wherever_it_found_the_target_last(make):
    sprite = texture(1, 40, 36)
    watch = make().watch()
    for _ in range(4):
        watch.remember(picture((sprite, START)), START)
    for step, x in enumerate((100, 145, 190)):
        box = START._replace(x=x)
        # What looks the same stands where the target was, just beyond what is searched.
        twin = box._replace(x=box.x - 100)
        assert_near(watch.search(picture((sprite, box), (sprite, twin), seed=step), box), box)


def test_what_is_forgotten_is_all_but_the_first_view(make):
    sprite, other, elsewhere = texture(1, 40, 36), texture(2, 40, 36), START._replace(x=110)
    for forget, likeliest in (False, elsewhere), (True, START):
        tracker = after_a_loss(make, (sprite, START), images=1)
        for _ in range(100):
            tracker.remember(picture((other, START)), START)
        if forget:
            tracker.forget_lately()
        searched(tracker, START, (sprite, START), (other, elsewhere))
        assert tracker.latest.box.iou(likeliest) > 0.5


def test_there_is_no_watch_where_it_is_switched_off():
    assert make_recovery(RecoveryConfig(tracker="compact", watch_score_min=1.0))().watch() is None
    assert make_recovery(RecoveryConfig(tracker="csrt"))().watch() is None


def test_noise_and_even_pictures_are_refused(make):
    tracker = after_a_loss(make, (texture(1, 40, 36), START))
    for seed in range(4):
        noise = np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
        assert tracker.search(noise, START) is None
        assert tracker.search(np.full((HEIGHT, WIDTH), 60 * seed, np.uint8), START) is None


def test_the_search_reaches_the_whole_image_in_the_end(make):
    sprite = texture(3, 30, 30)
    near, far = Box(10, 10, 30, 30), Box(200, 140, 30, 30)
    tracker = after_a_loss(make, (sprite, near), box=near)
    answers = searched(tracker, near, (sprite, far), images=150)
    assert answers[0] is None
    found = next(answer for answer in answers if answer is not None)
    assert_near(found, far)


def test_as_many_images_have_to_agree_as_are_asked_for(make):
    sprite = texture(1, 40, 36)
    tracker = after_a_loss(make, (sprite, START))
    *before, last = searched(tracker, START, (sprite, START), images=RecoveryConfig().network_agreeing)
    assert before
    assert not any(before)
    assert_near(last, START)


def test_places_that_jump_do_not_agree(make):
    sprite = texture(1, 40, 36)
    tracker = after_a_loss(make, (sprite, START))
    for shift in (0, 45, 0, 45):
        assert tracker.search(picture((sprite, START._replace(x=60 + shift))), START) is None


def test_what_a_failing_tracker_saw_last_is_not_learnt(make):
    target, occluder = texture(5, 40, 36), texture(6, 40, 36)
    tracker = after_a_loss(make, (target, START), images=45)
    for _ in range(19):
        tracker.remember(picture((occluder, START)), START)
    assert_near(searched(tracker, START, (target, START))[-1], START)


def test_a_look_alike_that_was_seen_beside_the_target_scores_less_afterwards(make):
    target = texture(7, 40, 36)
    beside = Box(130, 70, 40, 36)
    known = after_a_loss(make, (target, START), (target, beside))
    unknown = after_a_loss(make, (target, START))
    image = picture((target, beside))
    for tracker in (known, unknown):
        for _ in range(5):
            tracker.search(image, beside)
    assert known.latest.score < unknown.latest.score


def test_remembering_copies_pixels_and_leaves_the_network_alone(make):
    tracker = make()
    image = picture((texture(1, 40, 36), START))
    calls = []
    tracker._matcher = type("Counted", (), {"geometry": COMPACT_GEOMETRY, "template": lambda *_: calls.append(1)})()
    for _ in range(100):
        tracker.remember(image, START)
    assert calls == []


def test_a_remembered_image_may_be_reused(make):
    sprite = texture(1, 40, 36)
    tracker, image = make(), picture((sprite, START))
    tracker.remember(image, START)
    image[:] = 0
    assert_near(searched(tracker, START, (sprite, START))[-1], START)


def test_without_a_textured_memory_nothing_is_found(make):
    tracker = make()
    image = picture((texture(1, 40, 36), START))
    assert tracker.search(image, START) is None
    tracker.remember(np.full((HEIGHT, WIDTH), 128, np.uint8), START)
    tracker.remember(image, Box(-60, 10, 40, 36))
    assert tracker.search(image, START) is None


def test_targets_share_a_network_and_nothing_else(make):
    first, second = make(), make()
    image = picture((texture(1, 40, 36), START))
    first.remember(image, START)
    second.search(image, START)
    first.search(image, START)
    assert second.latest is None
    assert first.latest is not None


@settings(deadline=None, max_examples=30)
@given(
    x=st.floats(-30, 70), y=st.floats(-30, 60), w=st.floats(0.5, 120), h=st.floats(0.5, 120), seed=st.integers(0, 99)
)
def test_any_box_is_survived_and_what_is_found_lies_on_the_image(make, x, y, w, h, seed):
    image, box = texture(seed, 64, 48), Box(x, y, w, h)
    tracker = after_a_loss(make, box=box, images=2)
    tracker.remember(image, box)
    for _ in range(3):
        found = tracker.search(image, box)
        if found is not None:
            column, row = found.box.center
            assert 0 <= column < 64
            assert 0 <= row < 48


def test_a_tiny_target_on_a_large_sensor_is_searched_in_windows_of_bounded_size(make):
    tracker = make()
    sizes = []
    matcher = tracker._matcher

    class Watched:
        geometry = matcher.geometry
        template = staticmethod(matcher.template)

        @staticmethod
        def match(window, templates, distractors=()):
            sizes.append(window.size)
            return matcher.match(window, templates, distractors)

    tracker._matcher = Watched()
    box = Box(600, 350, 12, 12)
    image = picture((texture(1, 12, 12), box), width=1280, height=720)
    tracker.remember(image, box)
    tracker._searches = 3000
    for _ in range(5):
        tracker.search(image, box)
    assert max(sizes) <= 1.15 * matcher.geometry.window_pixels_max


def test_images_that_are_not_grey_are_refused(make):
    tracker = make()
    for image in (np.zeros((9, 9, 3), np.uint8), np.zeros((9, 9), np.float32), np.zeros((0, 9), np.uint8)):
        with pytest.raises(RecoveryError, match="grey images"):
            tracker.search(image, START)
        with pytest.raises(RecoveryError, match="grey images"):
            tracker.remember(image, START)


def test_folding_the_normalisations_in_changes_nothing():
    network = load_compact()
    window = torch.rand(1, 1, 128, 128) * 255
    with torch.inference_mode():
        before = network.features(window)
        after = fused(network).features(window)
    torch.testing.assert_close(after, before, atol=1e-4, rtol=1e-4)


def test_the_shipped_weights_are_small():
    assert SHIPPED.stat().st_size <= 8 << 20


def test_weights_of_another_network_and_damaged_ones_are_refused(tmp_path):
    from safetensors.torch import save_file

    path = tmp_path / "compact.safetensors"
    save_file({"layer": torch.zeros(2)}, path)
    with pytest.raises(RecoveryError, match="weights of another network"):
        load_compact(path)
    path.write_bytes(SHIPPED.read_bytes()[:-100])
    with pytest.raises(RecoveryError, match="no readable safetensors file"):
        load_compact(path)
    with pytest.raises(RecoveryError, match=r"missing\.safetensors"):
        make_recovery(RecoveryConfig(tracker="compact", compact_model=str(tmp_path / "missing.safetensors")))
    network = Compact()
    network.backbone[0].weight.data[0] = torch.inf
    save_compact(network, path, {})
    with pytest.raises(RecoveryError, match="not finite"):
        load_compact(path)


def test_weights_of_other_shapes_and_types_are_refused(tmp_path):
    from safetensors.torch import load_file, save_file

    state = load_file(SHIPPED)
    path = tmp_path / "compact.safetensors"
    save_file({**state, "backbone.0.weight": torch.zeros(9, 1, 3, 3)}, path, {"network": COMPACT})
    with pytest.raises(RecoveryError, match=r"backbone\.0\.weight has the shape \[9, 1, 3, 3\]"):
        load_compact(path)
    wide = {**state, "backbone.0.weight": state["backbone.0.weight"].double()}
    save_file(wide, path, {"network": COMPACT})
    with pytest.raises(RecoveryError, match=r"backbone\.0\.weight is torch\.float64, not torch\.float32"):
        load_compact(path)


def test_auto_is_the_network_and_says_so_once(monkeypatch, caplog):
    monkeypatch.setattr(making, "_told", set())
    with caplog.at_level("INFO"):
        assert making.chosen_tracker("auto") == "compact"
        assert making.chosen_tracker("auto") == "compact"
    assert [record.message for record in caplog.records] == [
        "Lost targets are searched with the recovery tracker 'compact'"
    ]
    assert isinstance(make_recovery(RecoveryConfig(tracker="auto"))(), SiameseRecovery)


def test_without_torch_auto_is_csrt_and_a_network_is_refused_with_the_cure(monkeypatch, caplog):
    monkeypatch.setattr(making, "find_spec", lambda name: None if name == "torch" else object())
    monkeypatch.setattr(making, "_told", set())
    with caplog.at_level("INFO"):
        assert making.chosen_tracker("auto") == "csrt"
    assert "torch cannot be found" in caplog.text
    for name in ("compact", "siamrpn"):
        with pytest.raises(RecoveryError, match="needs torch: pip install torch, or choose another tracker"):
            make_recovery(RecoveryConfig(tracker=name))


class _Overflowing:
    geometry = COMPACT_GEOMETRY

    def template(self, exemplar, size):
        return None

    def match(self, window, templates, distractors=()):
        scores = np.full((len(templates), 2, 2), np.nan, np.float32)
        return Answers(scores, np.full((len(templates), 4, 2, 2), 30.0, np.float32))


def test_scores_that_are_no_numbers_find_nothing():
    tracker = SiameseRecovery(_Overflowing(), RecoveryConfig())
    image = picture((texture(1, 40, 36), START))
    tracker.remember(image, START)
    assert tracker.search(image, START) is None
    assert tracker.latest is None


def test_the_networks_take_the_crops_that_their_geometry_says():
    assert COMPACT_GEOMETRY.margin == compact.FIRST_CENTER
    answers = CompactMatcher(load_compact())
    template = answers.template(np.zeros((64, 64), np.uint8), (32.0, 32.0))
    side = 2 * COMPACT_GEOMETRY.margin
    assert answers.match(np.zeros((side, side), np.uint8), [template]).scores.shape == (1, 1, 1)


def test_the_matcher_scores_every_template_at_every_place():
    matcher = CompactMatcher(load_compact())
    templates = [matcher.template(texture(seed, 64, 64), (32.0, 30.0)) for seed in range(3)]
    answers = matcher.match(texture(9, 160, 128), templates)
    assert answers.scores.shape == (3, 11, 15)
    assert answers.boxes.shape == (3, 4, 11, 15)
    assert ((answers.scores >= 0) & (answers.scores <= 1)).all()
    with_distractors = matcher.match(texture(9, 160, 128), templates[:1], templates[1:])
    np.testing.assert_array_equal(with_distractors.scores, answers.scores)
    np.testing.assert_array_equal(with_distractors.boxes, answers.boxes[:1])


def test_a_target_that_slid_behind_something_is_known_by_its_whole_self(make):
    sprite = texture(1, 40, 36)
    tracker = after_a_loss(make, (sprite, START), images=45)
    for width in (30, 20, 12):
        sliver = START._replace(w=width)
        for _ in range(20):
            tracker.remember(picture((sprite[:, :width], sliver)), sliver)
    moved = START._replace(x=110)
    assert_near(searched(tracker, START, (sprite, moved), images=12)[-1], moved)


def test_the_region_of_a_target_that_is_lost_grows_ten_times_as_fast_until_it_is_remembered_again(make):
    sprite = texture(1, 40, 36)
    tracker = after_a_loss(make, (sprite, START))
    far = START._replace(x=170)

    def searches(look_wider):
        tracker.remember(picture((sprite, START)), START)
        for number in range(1, 200):
            if look_wider:
                tracker.look_wider()
            tracker.search(picture((sprite, far)), START)
            if tracker.has_lead:
                return number
        return math.inf

    usual, lost = searches(look_wider=False), searches(look_wider=True)
    assert lost == pytest.approx(usual / 10, abs=1)
    assert lost > 1
    assert searches(look_wider=False) == usual
