"""ECO on pictures of simulated scenes, whose boxes are known."""

import cv2
import numpy as np
import pytest

from etd_ros.boxes import Box, BoxError
from etd_ros.simulation import TEXTURES, Path, Scene, Sprite, true_boxes
from etd_ros.systems.eco import EcoConfig, EcoTracker
from etd_ros.systems.interface import CompareError

WIDTH, HEIGHT, PICTURES = 240, 180, 30
TIMES = np.arange(PICTURES) * 0.04


def scene_of(pose, texture="blobs", size=(40, 36), seed=2):
    """A sprite of width and height `size` in front of clouds; `pose` gives x, y, and perhaps scale, of times."""
    rng = np.random.default_rng(seed)
    surface = TEXTURES[texture](rng, size[1], size[0])
    background = TEXTURES["smooth_noise"](rng, HEIGHT, WIDTH, grain=5.0)
    sprite = Sprite("target", surface, np.ones_like(surface), Path.of(pose, TIMES[-1]))
    return Scene(WIDTH, HEIGHT, float(TIMES[-1]) + 0.04, background, (sprite,))


def pictures_of(scene, number=PICTURES):
    return [np.clip(255 * np.exp(scene.render(time)), 0, 255).astype(np.uint8) for time in TIMES[:number]]


def boxes_of(scene, visible_min=0.5):
    return [box for _, box in true_boxes(scene, "target", TIMES, visible_min=visible_min)]


def answers(pictures, box):
    tracker = EcoTracker()
    tracker.start(pictures[0], box)
    return [tracker.update(picture) for picture in pictures[1:]]


def overlaps(found, boxes):
    return [answer.box.iou(box) for answer, box in zip(found, boxes[1:], strict=True)]


def circling(times):
    return 120 + 50 * np.cos(2 * times), 90 + 35 * np.sin(2 * times)


def growing(times):
    return 60 + 70 * times, 80 + 10 * times, 0.8 * 1.35**times


def shrinking(times):
    return 170 - 60 * times, 100 - 15 * times, 1.5 * 0.65**times


# Not stripes, which look the same one stripe farther on.
@pytest.mark.parametrize("texture", ["blobs", "checks", "smooth_noise"])
@pytest.mark.parametrize("pose", [circling, growing, shrinking])
def test_a_textured_sprite_is_followed_as_it_moves_and_changes_its_size(pose, texture):
    scene = scene_of(pose, texture)
    boxes = boxes_of(scene)
    found = answers(pictures_of(scene), boxes[0])
    ious = overlaps(found, boxes)
    assert np.mean(ious) > 0.8
    assert min(ious) > 0.7
    assert all(0 <= answer.score <= 1 for answer in found)


def test_what_is_learnt_of_a_target_that_moves_has_it_in_the_middle():
    # A tracker that forgets at once drifts with every picture whose target it has not put right.
    scene = scene_of(lambda times: (60 + 100 * times, 90 + 0 * times))
    pictures, boxes = pictures_of(scene), boxes_of(scene)
    tracker = EcoTracker(EcoConfig(learning_rate=0.5))
    tracker.start(pictures[0], boxes[0])
    found = [tracker.update(picture) for picture in pictures[1:]]
    assert min(overlaps(found, boxes)) > 0.7


@pytest.mark.parametrize("shift_px", [(0.0, 0.0), (0.5, -0.25), (3.3, 2.1), (-7.75, 5.5)])
def test_a_shift_is_found_to_a_fraction_of_a_pixel(shift_px):
    scene = scene_of(lambda times: (120 + shift_px[0] * (times > 0.02), 90 + shift_px[1] * (times > 0.02)))
    boxes = boxes_of(scene)
    (answer,) = answers(pictures_of(scene, 2), boxes[0])
    assert np.subtract(answer.box.center, boxes[0].center) == pytest.approx(shift_px, abs=0.5)


def test_the_score_falls_when_the_target_is_gone():
    scene = scene_of(circling)
    pictures = pictures_of(scene, 10)
    tracker = EcoTracker()
    tracker.start(pictures[0], boxes_of(scene)[0])
    seen = [tracker.update(picture).score for picture in pictures[1:]]
    hidden = tracker.update(np.full_like(pictures[0], 128)).score
    assert hidden < 0.5 * min(seen)


def test_colour_pictures_are_followed_by_their_grey_levels():
    scene = scene_of(circling)
    pictures, box = pictures_of(scene, 6), boxes_of(scene)[0]
    coloured = [cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) for picture in pictures]
    assert answers(coloured, box) == answers(pictures, box)


def test_the_same_pictures_give_the_same_answers_bit_by_bit():
    scene = scene_of(growing)
    pictures, box = pictures_of(scene), boxes_of(scene)[0]
    assert answers(pictures, box) == answers(pictures, box)


def test_trackers_side_by_side_do_not_disturb_each_other():
    scene, other_scene = scene_of(circling), scene_of(growing, "checks", seed=5)
    pictures, other_pictures = pictures_of(scene, 12), pictures_of(other_scene, 12)
    box, other_box = boxes_of(scene)[0], boxes_of(other_scene)[0]
    one, other = EcoTracker(), EcoTracker()
    one.start(pictures[0], box)
    other.start(other_pictures[0], other_box)
    together = [(one.update(a), other.update(b)) for a, b in zip(pictures[1:], other_pictures[1:], strict=True)]
    assert [a for a, _ in together] == answers(pictures, box)
    assert [b for _, b in together] == answers(other_pictures, other_box)


def test_a_tracker_can_be_started_again():
    scene, other_scene = scene_of(circling), scene_of(growing, "checks", seed=5)
    pictures, box = pictures_of(scene, 6), boxes_of(scene)[0]
    tracker = EcoTracker()
    tracker.start(pictures_of(other_scene, 1)[0], boxes_of(other_scene)[0])
    tracker.start(pictures[0], box)
    assert [tracker.update(picture) for picture in pictures[1:]] == answers(pictures, box)


def test_pictures_and_boxes_given_are_not_kept_and_not_changed():
    scene = scene_of(circling)
    pictures, box = pictures_of(scene, 6), boxes_of(scene)[0]
    reused, tracker = pictures[0].copy(), EcoTracker()
    tracker.start(reused, box)
    found = []
    for picture in pictures[1:]:
        reused[:] = picture
        found.append(tracker.update(reused))
        assert (reused == picture).all()
    assert found == answers(pictures, box)


@pytest.mark.parametrize("size", [(8, 8), (12, 7)])
def test_a_tiny_target_is_followed(size):
    scene = scene_of(lambda times: (100 + 30 * times, 80 + 15 * times), "blobs", size)
    boxes = boxes_of(scene)
    assert np.mean(overlaps(answers(pictures_of(scene), boxes[0]), boxes)) > 0.6


def test_a_target_as_large_as_the_picture_is_followed():
    scene = scene_of(lambda times: (115 + 10 * times, 88 + 4 * times), "blobs", (210, 160))
    boxes = boxes_of(scene)
    assert min(overlaps(answers(pictures_of(scene), boxes[0]), boxes)) > 0.8


def test_a_long_thin_target_is_followed():
    scene = scene_of(lambda times: (100 + 30 * times, 60 + 30 * times), "checks", (90, 14))
    boxes = boxes_of(scene)
    assert np.mean(overlaps(answers(pictures_of(scene), boxes[0]), boxes)) > 0.7


@pytest.mark.parametrize("corner", [(22.0, 20.0), (218.0, 162.0)])
def test_a_target_in_a_corner_of_the_picture_is_followed_from_there(corner):
    towards = 1 if corner[0] < 120 else -1
    scene = scene_of(lambda times: (corner[0] + towards * 40 * times, corner[1] + towards * 25 * times))
    boxes = boxes_of(scene)
    assert min(overlaps(answers(pictures_of(scene), boxes[0]), boxes)) > 0.7


def test_a_target_that_starts_partly_outside_is_followed_into_the_picture():
    scene = scene_of(lambda times: (8 + 60 * times, 90 + 0 * times))
    boxes = boxes_of(scene, visible_min=0.1)
    assert boxes[0].x < -10
    assert np.mean(overlaps(answers(pictures_of(scene), boxes[0]), boxes)) > 0.7


@pytest.mark.parametrize(
    "box", [Box(-30, -25, 40, 36), Box(230, 170, 40, 36), Box(-100, -100, 500, 500), Box(239, 0, 1, 1)]
)
def test_boxes_stay_finite_and_on_the_picture_whatever_comes(box):
    rng = np.random.default_rng(9)
    pictures = [rng.integers(0, 256, (HEIGHT, WIDTH)).astype(np.uint8) for _ in range(12)]
    pictures[6:8] = [np.zeros((HEIGHT, WIDTH), np.uint8)] * 2
    for answer in answers(pictures, box):
        answer.box.check(WIDTH, HEIGHT)
        assert 0 <= answer.score <= 1


def test_a_target_without_texture_stays_where_it_was():
    even = np.full((HEIGHT, WIDTH), 100, np.uint8)
    for answer in answers([even] * 8, Box(100, 80, 30, 20)):
        assert answer.box == pytest.approx(Box(100, 80, 30, 20), abs=0.5)


def test_a_target_that_leaves_is_still_looked_for_at_the_border():
    scene = scene_of(lambda times: (200 + 60 * times, 90 + 0 * times))
    for answer in answers(pictures_of(scene), boxes_of(scene)[0]):
        answer.box.check(WIDTH, HEIGHT)


@pytest.mark.parametrize(
    "picture",
    [np.zeros((20, 20), np.float32), np.zeros((20, 20, 4), np.uint8), np.zeros((0, 20), np.uint8), np.uint8([1])],
)
def test_pictures_of_other_kinds_are_refused_in_one_line(picture):
    with pytest.raises(CompareError, match=r"ECO was given a picture of .*: give uint8 of shape"):
        EcoTracker().start(picture, Box(2, 2, 5, 5))


def test_a_picture_of_another_size_is_refused():
    tracker = EcoTracker()
    tracker.start(np.zeros((180, 240), np.uint8), Box(20, 20, 30, 30))
    with pytest.raises(CompareError, match="started on pictures of 240x180 and was given one of 100x80"):
        tracker.update(np.zeros((80, 100), np.uint8))


def test_a_picture_before_the_start_is_refused():
    with pytest.raises(CompareError, match="call start"):
        EcoTracker().update(np.zeros((80, 100), np.uint8))


@pytest.mark.parametrize("box", [Box(300, 20, 30, 30), Box(20, 20, 0, 30), Box(float("nan"), 1, 2, 3)])
def test_a_box_that_no_target_can_have_is_refused(box):
    with pytest.raises(BoxError):
        EcoTracker().start(np.zeros((180, 240), np.uint8), box)
