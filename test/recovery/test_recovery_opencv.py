"""A lost target is found where it comes out again; nothing else is ever taken for it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recovery_networks import other_network, tiny_vit

from etd_ros.boxes import Box
from etd_ros.parameters import ParameterError
from etd_ros.recovery import Found, RecoveryConfig, RecoveryError, make_recovery
from etd_ros.recovery.appearance import Exemplar, correlation, correlation_map

WIDTH, HEIGHT = 240, 180
START = Box(60, 70, 40, 36)


def texture(seed: int, width: int, height: int) -> np.ndarray:
    """A smooth random pattern over the whole grey range, uint8."""
    noise = np.random.default_rng(seed).normal(size=(height, width)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def scene(sprite: np.ndarray | None, box: Box, *, width=WIDTH, height=HEIGHT, seed: int = 0) -> np.ndarray:
    """A sprite at a box on an even, slightly noisy ground."""
    image = np.full((height, width), 128, np.uint8)
    if sprite is not None:
        rows, columns = round(box.h), round(box.w)
        image[int(box.y) : int(box.y) + rows, int(box.x) : int(box.x) + columns] = cv2.resize(sprite, (columns, rows))
    noise = np.random.default_rng(seed).normal(0, 3, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def after_a_loss(image: np.ndarray, box: Box, *, remembered: int = 50, **options):
    tracker = make_recovery(RecoveryConfig(**{"tracker": "csrt", **options}))()
    for _ in range(remembered):
        tracker.remember(image, box)
    return tracker


def assert_near(found: Found | None, box: Box, *, pixels: float = 2.0) -> None:
    assert found is not None
    np.testing.assert_allclose(found.box, box, atol=pixels)
    assert 0.75 <= found.score <= 1.0


@pytest.mark.parametrize("name", ["csrt", "kcf"])
def test_a_target_that_moved_40_px_behind_something_is_found_when_it_comes_out(name):
    sprite = texture(1, 40, 36)
    tracker = after_a_loss(scene(sprite, START), START, tracker=name)
    for blank in range(5):
        assert tracker.search(scene(None, START, seed=blank), START) is None
    moved = START._replace(x=100, y=76)
    assert_near(tracker.search(scene(sprite, moved, seed=9), START), moved)


@pytest.mark.parametrize("name", ["csrt", "kcf"])
def test_noise_and_other_textures_are_refused(name):
    tracker = after_a_loss(scene(texture(1, 40, 36), START), START, tracker=name)
    for seed in range(5):
        noise = np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8)
        assert tracker.search(noise, START) is None
        assert tracker.search(scene(texture(100 + seed, 40, 36), START), START) is None
        assert tracker.search(np.full((HEIGHT, WIDTH), 50 * seed, np.uint8), START) is None


@pytest.mark.parametrize("name", ["csrt", "kcf"])
def test_a_mirrored_target_is_another_one(name):
    sprite = texture(1, 40, 36)
    tracker = after_a_loss(scene(sprite, START), START, tracker=name)
    assert tracker.search(scene(sprite[::-1, ::-1], START), START) is None


def test_a_target_of_another_size_is_found_within_the_ratio_allowed():
    sprite = texture(4, 40, 36)
    larger = Box(80, 80, 44, 40)
    found = after_a_loss(scene(sprite, START), START).search(scene(sprite, larger), START)
    assert_near(found, larger, pixels=4)


def test_a_large_target_is_found_on_a_large_sensor():
    sprite = texture(2, 60, 60)
    box, moved = Box(300.0, 200.0, 240.0, 210.0), Box(520.0, 260.0, 240.0, 210.0)
    tracker = after_a_loss(scene(sprite, box, width=1280, height=720), box)
    found = tracker.search(scene(sprite, moved, width=1280, height=720, seed=5), box)
    assert_near(found, moved, pixels=6)


def test_the_search_region_grows_until_it_holds_the_target():
    sprite = texture(3, 20, 20)
    box, far = Box(20, 20, 20, 20), Box(120, 100, 20, 20)
    tracker = after_a_loss(scene(sprite, box), box, search_scale=2.0, search_growth=1.0, search_scale_max=12.0)
    image = scene(sprite, far, seed=1)
    answers = [tracker.search(image, box) for _ in range(11)]
    assert answers[0] is None
    assert_near(answers[-1], far)


def test_tracking_again_makes_the_search_region_small_again():
    sprite = texture(3, 20, 20)
    box, far = Box(20, 20, 20, 20), Box(120, 100, 20, 20)
    tracker = after_a_loss(scene(sprite, box), box, search_scale=2.0, search_growth=10.0, search_scale_max=12.0)
    tracker.search(scene(None, box), box)
    tracker.remember(scene(sprite, box), box)
    assert tracker.search(scene(sprite, far), box) is None
    assert_near(tracker.search(scene(sprite, far), box), far)


def test_what_a_failing_tracker_saw_last_is_not_searched_for():
    target, occluder = texture(5, 40, 36), texture(6, 40, 36)
    tracker = after_a_loss(scene(target, START), START, remembered=45, exemplar_interval=20)
    for _ in range(19):
        tracker.remember(scene(occluder, START), START)
    assert tracker.search(scene(occluder, START), START) is None
    assert_near(tracker.search(scene(target, START), START), START)


def test_a_target_that_changed_its_looks_slowly_is_known_by_the_new_ones():
    old, new = texture(7, 40, 36), texture(8, 40, 36)
    tracker = after_a_loss(scene(old, START), START, remembered=30, exemplar_interval=10)
    for _ in range(30):
        tracker.remember(scene(new, START), START)
    assert_near(tracker.search(scene(new, START), START), START)
    assert_near(tracker.search(scene(old, START), START), START)


def test_a_remembered_image_may_be_reused():
    sprite = texture(1, 40, 36)
    image = scene(sprite, START)
    tracker = after_a_loss(image, START)
    image[:] = 0
    assert_near(tracker.search(scene(sprite, START, seed=4), START), START)


def test_without_a_textured_memory_nothing_is_found():
    tracker = make_recovery(RecoveryConfig(tracker="csrt"))()
    assert tracker.search(scene(texture(1, 40, 36), START), START) is None
    tracker.remember(np.full((HEIGHT, WIDTH), 128, np.uint8), START)
    tracker.remember(scene(texture(1, 40, 36), START), Box(-60, 10, 40, 36))
    assert tracker.search(np.full((HEIGHT, WIDTH), 128, np.uint8), START) is None


def test_trackers_of_different_targets_share_nothing():
    make = make_recovery(RecoveryConfig(tracker="csrt"))
    first, second = make(), make()
    first.remember(scene(texture(1, 40, 36), START), START)
    assert second.search(scene(texture(1, 40, 36), START), START) is None


@settings(deadline=None, max_examples=40)
@given(
    x=st.floats(-30, 70),
    y=st.floats(-30, 60),
    w=st.floats(0.5, 120),
    h=st.floats(0.5, 120),
    seed=st.integers(0, 1000),
    name=st.sampled_from(["csrt", "kcf"]),
)
def test_any_box_is_survived_and_what_is_found_lies_on_the_image(x, y, w, h, seed, name):
    image = texture(seed, 64, 48)
    box = Box(x, y, w, h)
    found = after_a_loss(image, box, remembered=2, exemplar_interval=1, tracker=name).search(image, box)
    if found is not None:
        column, row = found.box.center
        assert 0 <= column < 64
        assert 0 <= row < 48
        assert 0.75 <= found.score <= 1.0


@pytest.mark.parametrize("size", [(8, 150), (10, 160), (5, 80)])
def test_what_is_much_longer_than_wide_is_found(size):
    box = Box(120 - size[0] // 2, 90 - size[1] // 2, *size)
    image = scene(texture(1, 40, 36), box)
    assert_near(after_a_loss(image, box).search(image, box), box)


def test_images_that_are_not_grey_are_refused():
    tracker = make_recovery(RecoveryConfig(tracker="csrt"))()
    for image in (np.zeros((9, 9, 3), np.uint8), np.zeros((9, 9), np.float32), np.zeros((0, 9), np.uint8)):
        with pytest.raises(RecoveryError, match="grey images"):
            tracker.search(image, START)
        with pytest.raises(RecoveryError, match="grey images"):
            tracker.remember(image, START)


def test_models_that_are_not_named_not_there_or_not_models_are_refused_at_once(tmp_path):
    with pytest.raises(RecoveryError, match="set the parameter recovery.dasiamrpn_model"):
        make_recovery(RecoveryConfig(tracker="dasiamrpn"))
    missing = tmp_path / "missing.onnx"
    with pytest.raises(RecoveryError, match=r"missing\.onnx: no readable file"):
        make_recovery(RecoveryConfig(tracker="dasiamrpn", dasiamrpn_model=str(missing)))
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"not a network")
    files = {name: str(broken) for name in ("dasiamrpn_model", "dasiamrpn_kernel_cls1", "dasiamrpn_kernel_r1")}
    with pytest.raises(RecoveryError, match=r"broken\.onnx: OpenCV's TrackerDaSiamRPN cannot track with this"):
        make_recovery(RecoveryConfig(tracker="dasiamrpn", **files))


@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("vit", ("vit_model",)),
        ("nano", ("nano_backbone", "nano_head")),
        ("dasiamrpn", ("dasiamrpn_model", "dasiamrpn_kernel_cls1", "dasiamrpn_kernel_r1")),
    ],
)
def test_files_of_another_network_are_refused_at_once_in_one_line(tmp_path, name, fields):
    other = tmp_path / "other.onnx"
    other.write_bytes(other_network())
    with pytest.raises(RecoveryError, match=r"other\.onnx: .*cannot track with this") as refused:
        make_recovery(RecoveryConfig(tracker=name, **dict.fromkeys(fields, str(other))))
    assert all(f"recovery.{field}" in str(refused.value) for field in fields)
    assert "\n" not in str(refused.value)


def test_a_network_of_the_trackers_own_kind_is_taken_and_finds_what_correlation_proposes(tmp_path):
    (tmp_path / "vit.onnx").write_bytes(tiny_vit())
    sprite = texture(1, 40, 36)
    tracker = after_a_loss(scene(sprite, START), START, tracker="vit", vit_model=str(tmp_path / "vit.onnx"))
    moved = START._replace(x=100, y=76)
    assert_near(tracker.search(scene(sprite, moved, seed=9), START), moved)


def test_a_network_that_is_gone_while_it_is_used_leaves_what_correlation_finds(tmp_path):
    (tmp_path / "vit.onnx").write_bytes(tiny_vit())
    sprite = texture(1, 40, 36)
    tracker = after_a_loss(scene(sprite, START), START, tracker="vit", vit_model=str(tmp_path / "vit.onnx"))
    (tmp_path / "vit.onnx").write_bytes(other_network())
    moved = START._replace(x=100, y=76)
    assert_near(tracker.search(scene(sprite, moved, seed=9), START), moved)


def test_an_opencv_without_the_tracker_is_named_with_the_cure(monkeypatch):
    monkeypatch.delattr(cv2, "TrackerCSRT_create")
    with pytest.raises(RecoveryError, match="has no TrackerCSRT; install OpenCV .*contrib"):
        make_recovery(RecoveryConfig(tracker="csrt"))


def test_an_unknown_tracker_is_refused():
    with pytest.raises(ParameterError, match="tracker = 'tld'"):
        RecoveryConfig(tracker="tld")


def test_the_correlation_map_agrees_with_the_correlation_of_every_place():
    window, patch = texture(11, 30, 26), texture(12, 9, 7)
    window[:12, :12] = 77
    expected = [
        [correlation(patch, window[row : row + 7, column : column + 9], 5.0) for column in range(22)]
        for row in range(20)
    ]
    np.testing.assert_allclose(correlation_map(window, patch, 5.0), expected, atol=1e-3)


def test_a_patch_larger_than_the_window_has_no_place():
    assert correlation_map(np.zeros((5, 5), np.uint8), np.zeros((6, 4), np.uint8), 5.0).size == 0


def test_an_exemplar_is_the_boxs_pixels_and_their_surroundings():
    image = texture(13, WIDTH, HEIGHT)
    exemplar = Exemplar.cut(image, START)
    np.testing.assert_array_equal(exemplar.patch, image[70:106, 60:100])
    x, y, w, h = exemplar.context_box
    np.testing.assert_array_equal(exemplar.context[y : y + h, x : x + w], exemplar.patch)


@pytest.mark.parametrize("name", ["csrt", "kcf"])
def test_the_region_of_a_target_that_is_lost_grows_ten_times_as_fast(name):
    sprite = texture(1, 40, 36)
    far = START._replace(x=170)

    def searches(look_wider):
        tracker = after_a_loss(scene(sprite, START), START, tracker=name)
        for number in range(1, 100):
            if look_wider:
                tracker.look_wider()
            if tracker.search(scene(sprite, far), START):
                return number
        return math.inf

    usual, lost = searches(look_wider=False), searches(look_wider=True)
    # The first one is larger already.
    assert (usual - 1) / 10 <= lost <= (usual - 1) / 10 + 1
    assert lost > 1
