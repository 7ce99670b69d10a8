"""Overlays show what they are given where it is; videos appear whole or not at all."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.detection import Proposals
from etd_ros.overlay import (
    BAR_HEIGHT,
    GROUND,
    OFF,
    ON,
    PROPOSAL,
    STATE_COLOURS,
    TRUTH,
    OverlayError,
    VideoWriter,
    draw_overlay,
)
from etd_ros.overlay_history import History
from etd_ros.tracking import Search, TargetReport, TargetState

WIDTH, HEIGHT = 240, 180
BOX = Box(100, 60, 40, 30)


def frame() -> np.ndarray:
    return np.zeros((HEIGHT, WIDTH, 2), np.uint8)


def report(
    state=TargetState.TRACKING, box: Box | None = BOX, name: str = "cup", search: Search | None = None
) -> TargetReport:
    return TargetReport(name, state, box, 0.8, search)


def search(*boxes: Box, scores=()) -> Search:
    return Search(BOX.scaled(1.5), Proposals(np.array(boxes, float).reshape(-1, 4), np.array(scores, float)))


def has_colour(picture: np.ndarray, colour) -> bool:
    return bool((picture == np.array(colour)).all(axis=2).any())


def test_events_have_their_polaritys_colour_and_fade_as_they_decay():
    data = frame()
    data[10, 20, 0], data[30, 40, 1], data[50, 60, 0] = 255, 255, 100
    picture = draw_overlay(data, [], scale=1)
    assert tuple(picture[10, 20]) == ON
    assert tuple(picture[30, 40]) == OFF
    assert tuple(picture[0, 0]) == GROUND
    assert sum(GROUND) < picture[50, 60].sum() < sum(ON)


def test_pictures_are_shown_as_they_are_in_grey_and_in_colour():
    colour = np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH, 3), np.uint8)
    for picture, expected in ((colour, colour), (colour[..., 0], np.repeat(colour[..., :1], 3, axis=2))):
        before = picture.copy()
        drawn = draw_overlay(picture, [], scale=1)
        np.testing.assert_array_equal(drawn[:HEIGHT], expected)
        draw_overlay(picture, [report()], scale=1)
        np.testing.assert_array_equal(picture, before)


def test_a_score_that_a_system_does_not_give_is_left_out():
    unsure = dataclasses.replace(report(), score=float("nan"))
    bars = [draw_overlay(frame(), [shown], scale=2)[-BAR_HEIGHT:] for shown in (unsure, report())]
    assert (bars[0] != GROUND).any(axis=(0, 2)).nonzero()[0].max() < (bars[1] != GROUND).any(axis=(0, 2)).nonzero()[
        0
    ].max()


def test_of_two_polarities_at_a_pixel_the_later_one_shows():
    data = frame()
    data[10, 20] = 100, 255
    assert tuple(draw_overlay(data, [], scale=1)[10, 20]) == OFF


@pytest.mark.parametrize("state", list(TargetState))
@pytest.mark.parametrize("scale", [1, 2, 3])
def test_a_box_is_drawn_where_it_is_in_its_states_colour(state, scale):
    picture = draw_overlay(frame(), [report(state)], scale=scale)
    colour = STATE_COLOURS[state]
    for column, row in ((100, 75), (140, 75), (120, 90)):
        assert tuple(picture[row * scale, column * scale]) == colour
    inside = picture[64 * scale : 86 * scale, 104 * scale : 136 * scale]
    assert (inside == np.array(GROUND)).all()


def test_every_state_has_its_own_colour():
    assert set(STATE_COLOURS) == set(TargetState)
    assert len(set(STATE_COLOURS.values())) == len(TargetState)


def test_a_target_without_a_box_is_named_in_the_bar_only():
    lost = report(TargetState.LOST, None)
    picture, empty = draw_overlay(frame(), [lost]), draw_overlay(frame(), [])
    np.testing.assert_array_equal(picture[:-BAR_HEIGHT], empty[:-BAR_HEIGHT])
    assert (picture[-BAR_HEIGHT:] != empty[-BAR_HEIGHT:]).any()


def test_proposals_are_drawn_where_they_are_only_when_asked_for_the_fainter_the_worse():
    best, worse = Box(150, 100, 20, 20), Box(50, 100, 20, 20)
    reports = [report(search=search(best, worse, scores=(0.4, 0.1)))]
    without, drawn = (draw_overlay(frame(), reports, scale=2, proposals=asked) for asked in (False, True))
    np.testing.assert_array_equal(without, draw_overlay(frame(), [report()], scale=2))
    strengths = []
    for box in (best, worse):
        for x, y in ((box.x, box.y + 10), (box.x + 20, box.y + 10), (box.x + 10, box.y + 20)):
            pixel = drawn[int(2 * y), int(2 * x)].astype(int)
            strengths.append((pixel - GROUND).sum() / (np.array(PROPOSAL) - GROUND).sum())
        inside = drawn[int(2 * box.y) + 2 : int(2 * box.y) + 38, int(2 * box.x) + 2 : int(2 * box.x) + 38]
        assert (inside == np.array(GROUND)).all()
    assert min(strengths[:3]) > 1.5 * max(strengths[3:]) > 0


def test_a_box_lies_over_the_proposals():
    reports = [report(search=search(BOX, scores=(0.0,)))]
    picture = draw_overlay(frame(), reports, scale=2, proposals=True)
    np.testing.assert_array_equal(picture, draw_overlay(frame(), [report()], scale=2))


def test_of_thousands_of_proposals_the_best_are_drawn():
    far = Box(5, 120, 10, 10)
    reports = [report(search=search(*[BOX] * 999, far, scores=np.linspace(1, 0, 1000)))]
    picture = draw_overlay(frame(), reports, scale=1, proposals=True)
    assert (picture[115:135, :20] == np.array(GROUND)).all()


def test_where_a_target_is_being_recovered_is_dashed_in_its_colour_and_named():
    recovering = report(TargetState.RECOVERING, None, search=search())
    picture = draw_overlay(frame(), [recovering], scale=2)
    region, colour = recovering.search.region, np.array(STATE_COLOURS[TargetState.RECOVERING])
    for line in (
        picture[int(2 * (region.y + region.h)), int(2 * region.x) + 2 : int(2 * (region.x + region.w)) - 2],
        picture[int(2 * region.y) + 2 : int(2 * (region.y + region.h)) - 2, int(2 * region.x)],
    ):
        assert 0.3 < (line == colour).all(axis=1).mean() < 0.7
    tag = picture[int(2 * region.y) - 15 : int(2 * region.y) - 2, int(2 * region.x) + 1 : int(2 * region.x) + 10]
    assert has_colour(tag, colour)
    lost = report(TargetState.LOST, None, search=search())
    np.testing.assert_array_equal(
        draw_overlay(frame(), [lost]), draw_overlay(frame(), [report(TargetState.LOST, None)])
    )


def test_truth_is_thin_and_grey_whatever_the_target_does():
    picture = draw_overlay(frame(), [report(TargetState.LOST, None)], scale=2, truth={"cup": BOX})
    assert tuple(picture[150, 200]) == tuple(picture[150, 280]) == tuple(picture[120, 240]) == TRUTH
    assert tuple(picture[150, 201]) == tuple(picture[150, 199]) == GROUND


def seen(*reports_by_frame, interval_ns: int = 10_000_000) -> History:
    history = History()
    for index, reports in enumerate(reports_by_frame):
        history.take(index * interval_ns, reports)
    return history


def test_the_trail_shows_where_the_box_came_from_fresher_towards_the_box():
    boxes = [Box(20 + 5 * step, 60, 40, 30) for step in range(17)]
    history = seen(*([report(box=box)] for box in boxes), interval_ns=20_000_000)
    picture = draw_overlay(frame(), [report(box=boxes[-1])], scale=1, history=history)
    row = picture[75, 42:98].sum(axis=1).astype(int)
    assert (row > sum(GROUND)).all()
    assert row[-1] > 1.5 * row[0]
    assert (picture[64:86, 104:136] == np.array(GROUND)).all(), "the trail hides the target"


def test_a_trail_is_forgotten_with_age_with_the_target_and_when_time_goes_back():
    here, there = report(box=Box(20, 60, 40, 30)), report(box=Box(120, 60, 40, 30))
    history = seen([here], [there])
    np.testing.assert_allclose(history.trail("cup"), [[40, 75, 0.975], [140, 75, 1]])
    assert len(history.trail("stranger")) == 0
    assert len(seen([here], [there], interval_ns=500_000_000).trail("cup")) == 1
    assert len(seen([here], [], [there]).trail("cup")) == 1
    history.take(5_000_000, [there])
    assert len(history.trail("cup")) == 1


def test_a_target_that_is_found_again_lights_up_for_a_moment():
    missed = report(TargetState.RECOVERING, None)
    flashes = [seen([report()], [missed], *[[report()]] * count).flash("cup") for count in (0, 1, 11, 20, 21, 40)]
    assert flashes[:2] == [0, 1]
    assert flashes[2] == pytest.approx(0.5)
    assert flashes[3:] == pytest.approx([0.05, 0, 0])
    assert seen([report(TargetState.IDLE, None)], [report()]).flash("cup") == 0

    history = seen([report()], [missed], [report()], [report()], [report()])
    picture, plain = (draw_overlay(frame(), [report()], scale=2, history=shown) for shown in (history, None))
    changed = (picture != plain).any(axis=2)
    inside, ring = (slice(125, 175), slice(205, 275)), (slice(180, 190), slice(220, 270))
    far = (slice(250, 330), slice(0, 480))
    assert changed[inside].all()
    assert changed[ring].any(axis=0).all()
    assert not changed[far].any()


def test_targets_that_do_not_fit_into_the_bar_are_counted():
    names = [f"target_{index}" for index in range(12)]
    some, all_but_one, every = (
        draw_overlay(frame(), [report(name=name) for name in names[:count]], scale=3)[-BAR_HEIGHT:]
        for count in (3, 11, 12)
    )
    columns = np.flatnonzero((every != some).any(axis=(0, 2)))
    assert (every != all_but_one).any(), "the number of those left out is not written"
    assert columns.max() < every.shape[1] - 8


def test_the_stamp_is_written():
    one, other = (draw_overlay(frame(), [], stamp_ns=stamp_ns) for stamp_ns in (1_500_000_000, 1_600_000_000))
    assert (one[-BAR_HEIGHT:] != other[-BAR_HEIGHT:]).any()


def test_the_image_stands_beside_the_events_with_the_boxes_on_both():
    image = np.full((HEIGHT, WIDTH), 90, np.uint8)
    picture = draw_overlay(frame(), [report()], image=image)
    half = picture.shape[1] // 2
    assert tuple(picture[0, half]) == (90, 90, 90)
    for panel in (picture[:-BAR_HEIGHT, :half], picture[:-BAR_HEIGHT, half:]):
        assert has_colour(panel, STATE_COLOURS[TargetState.TRACKING])


@pytest.mark.parametrize(("width", "height"), [(1, 1), (33, 17), (240, 180), (346, 260), (640, 480), (1280, 720)])
def test_pictures_have_even_sides_and_a_readable_width(width, height):
    data = np.zeros((height, width, 2), np.uint8)
    for image in (None, np.zeros((height, width), np.uint8)):
        picture = draw_overlay(data, [report()], image=image, stamp_ns=0)
        assert picture.shape[0] % 2 == picture.shape[1] % 2 == 0
        assert 640 <= picture.shape[1] <= 1280


@pytest.mark.parametrize(
    "box", [Box(-1e12, -1e12, 2e12, 2e12), Box(-30, -30, 40, 40), Box(230, 170, 40, 40), Box(1e9, 5, 3, 3)]
)
def test_boxes_off_the_sensor_and_odd_names_are_survived(box):
    missed = report(TargetState.RECOVERING, None, search=Search(box, Proposals.none()))
    shown = report(box=box, name="Tür \U0001f3be" * 40, search=search(box, scores=(1.0,)))
    history = seen([report()], [missed], [shown], [shown])
    draw_overlay(frame(), [shown, missed], proposals=True, truth={"cup": box}, history=history)


def test_the_arguments_are_left_as_they_are():
    data, image = frame(), np.full((HEIGHT, WIDTH), 90, np.uint8)
    draw_overlay(data, [report()], image=image, scale=1)
    assert not data.any()
    assert (image == 90).all()


@pytest.mark.parametrize(
    ("data", "options", "words"),
    [
        (np.zeros((4, 4, 4), np.uint8), {}, "needs a frame"),
        (np.zeros((4, 4, 2), np.float32), {}, "needs a frame"),
        (np.zeros((0, 4, 2), np.uint8), {}, "needs a frame"),
        (np.zeros((4, 4, 2), np.uint8), {"image": np.zeros((4, 5), np.uint8)}, "needs an image"),
        (np.zeros((4, 4, 2), np.uint8), {"scale": -1.0}, "scale"),
        (np.zeros((4, 4, 2), np.uint8), {"scale": 0.0}, "scale"),
    ],
)
def test_wrong_arguments_are_named(data, options, words):
    with pytest.raises(OverlayError, match=words):
        draw_overlay(data, [], **options)


def test_a_video_holds_the_pictures_in_the_first_ones_size(tmp_path):
    path = tmp_path / "out.mp4"
    image = np.full((HEIGHT, WIDTH), 200, np.uint8)
    with VideoWriter(path, 30) as video:
        video.write(draw_overlay(frame(), []))
        video.write(draw_overlay(frame(), [], image=image))
        video.write(draw_overlay(frame(), []))
        assert not path.exists()
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.mp4"]
    capture = cv2.VideoCapture(str(path))
    pictures = []
    while (answer := capture.read())[0]:
        pictures.append(answer[1])
    capture.release()
    expected = draw_overlay(frame(), [])
    assert [picture.shape for picture in pictures] == [expected.shape] * 3
    assert np.abs(pictures[0].astype(int) - expected).mean() < 5
    assert pictures[1].mean() > 2 * pictures[0].mean()


def test_a_video_that_fails_leaves_nothing(tmp_path):
    def write_and_fail():
        with VideoWriter(tmp_path / "out.mp4", 30) as video:
            video.write(draw_overlay(frame(), []))
            raise KeyError

    with pytest.raises(KeyError):
        write_and_fail()
    assert list(tmp_path.iterdir()) == []


def test_a_video_without_pictures_is_no_file(tmp_path):
    with VideoWriter(tmp_path / "out.mp4", 30):
        pass
    assert list(tmp_path.iterdir()) == []


def test_places_where_no_video_can_be_written_are_refused_at_once(tmp_path):
    (tmp_path / "folder.mp4").mkdir()
    for path in (tmp_path / "folder.mp4", tmp_path / "absent" / "out.mp4"):
        with pytest.raises(OverlayError, match="cannot be written"):
            VideoWriter(path, 30)
    with pytest.raises(OverlayError, match="MP4"):
        VideoWriter(tmp_path / "out.gif", 30)
