"""Overlays show what they are given where it is; videos appear whole or not at all."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.overlay import BAR_HEIGHT, GROUND, OFF, ON, STATE_COLOURS, OverlayError, VideoWriter, draw_overlay
from etd_ros.tracking import TargetReport, TargetState

WIDTH, HEIGHT = 240, 180
BOX = Box(100, 60, 40, 30)


def frame() -> np.ndarray:
    return np.zeros((HEIGHT, WIDTH, 2), np.uint8)


def report(state=TargetState.TRACKING, box: Box | None = BOX, name: str = "cup") -> TargetReport:
    return TargetReport(name, state, box, 0.8)


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
    draw_overlay(frame(), [report(box=box, name="Tür \U0001f3be" * 40)])


def test_the_arguments_are_left_as_they_are():
    data, image = frame(), np.full((HEIGHT, WIDTH), 90, np.uint8)
    draw_overlay(data, [report()], image=image, scale=1)
    assert not data.any()
    assert (image == 90).all()


@pytest.mark.parametrize(
    ("data", "options", "words"),
    [
        (np.zeros((4, 4), np.uint8), {}, "needs a frame"),
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
