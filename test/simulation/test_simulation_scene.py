"""Scenes: paths, sprites, exact boxes and what hides what; and the textures they wear."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.boxes import Box
from etd_ros.simulation import TEXTURES, Path, Scene, SimulationError, Sprite, Waypoint, demo_scene
from etd_ros.simulation.textures import BRIGHT, DARK

GROUND, FRONT = 0.2, 0.8


def square(name: str, x: float, y: float, *, size: tuple[int, int] = (8, 12), scale: float = 1.0, **options) -> Sprite:
    return Sprite(name, np.full(size, FRONT), np.ones(size), Path([Waypoint(0.0, x, y, scale)]), **options)


def scene_of(*sprites: Sprite) -> Scene:
    return Scene(64, 48, 1.0, np.full((48, 64), GROUND), sprites)


@settings(deadline=None, max_examples=40)
@given(x=st.floats(20, 44), y=st.floats(16, 32), scale=st.floats(0.5, 1.5))
def test_a_box_bounds_the_pixels_that_its_sprite_covers(x, y, scale):
    sprite = square("thing", x, y, scale=scale)
    cover = (np.exp(scene_of(sprite).render(0.0)) - GROUND) / (FRONT - GROUND)
    rows, columns = np.nonzero(cover >= 0.5)
    box = scene_of(sprite).box("thing", 0.0)
    # A pixel's centre is half a pixel from its border.
    assert columns.min() == pytest.approx(box.x, abs=0.501)
    assert columns.max() + 1 == pytest.approx(box.x + box.w, abs=0.501)
    assert rows.min() == pytest.approx(box.y, abs=0.501)
    assert rows.max() + 1 == pytest.approx(box.y + box.h, abs=0.501)


def test_sprites_off_the_sensor_are_cut_at_its_border():
    inside = scene_of(square("thing", 0.0, 0.0)).render(0.0)
    assert inside[:4, :6] == pytest.approx(np.log(FRONT))
    assert inside[5:, :] == pytest.approx(np.log(GROUND))
    assert scene_of(square("thing", -500.0, 900.0)).render(0.0) == pytest.approx(np.log(GROUND))


def test_later_sprites_hide_earlier_ones():
    hidden = square("hidden", 32.0, 24.0)
    cover = Sprite("cover", np.full((8, 6), 0.4), np.ones((8, 6)), Path([Waypoint(0, 29.0, 24.0)]), is_target=False)
    scene = scene_of(hidden, cover)
    image = np.exp(scene.render(0.0))
    assert image[24, 28] == pytest.approx(0.4)
    assert image[24, 35] == pytest.approx(FRONT)
    assert scene.visible_share("hidden", 0.0) == pytest.approx(0.5)
    assert scene.boxes(0.0) == {"hidden": Box(26.0, 20.0, 12.0, 8.0)}
    assert scene.boxes(0.0, visible_min=0.51) == {}


def test_half_a_sprite_beyond_the_border_is_half_visible():
    assert scene_of(square("thing", 0.0, 24.0)).visible_share("thing", 0.0) == pytest.approx(0.5, abs=0.01)


def test_the_tin_of_the_demo_passes_behind_the_pillar_and_the_others_stay_in_sight():
    scene = demo_scene(7)
    shares = {
        name: np.array([scene.visible_share(name, time_s) for time_s in np.arange(0.1, 5.0, 0.05)])
        for name in ("ball", "drum", "tin")
    }
    assert shares["ball"] == pytest.approx(1.0, abs=1e-6)
    assert shares["drum"] == pytest.approx(1.0, abs=1e-6)
    tin = shares["tin"]
    assert tin[0] == pytest.approx(1.0)
    assert tin.min() < 0.01
    assert tin[-1] == pytest.approx(1.0)
    hidden = np.flatnonzero(tin < 0.5)
    assert np.array_equal(hidden, np.arange(hidden[0], hidden[-1] + 1)), "it is hidden once, for a while"


def test_an_occluder_is_no_target():
    assert set(demo_scene(7).boxes(0.1)) == {"ball", "drum", "tin"}


def test_a_path_runs_straight_between_two_waypoints_and_stays_at_its_ends():
    path = Path([Waypoint(1.0, 10.0, 20.0, 1.0), Waypoint(3.0, 30.0, 0.0, 2.0)])
    assert path.at(2.0) == pytest.approx((20.0, 10.0, 1.5, 0.0))
    assert path.at(0.0) == pytest.approx((10.0, 20.0, 1.0, 0.0))
    assert path.at(9.0) == pytest.approx((30.0, 0.0, 2.0, 0.0))


def test_a_single_waypoint_stands_still():
    path = Path([Waypoint(1.0, 10.0, 20.0, 3.0)])
    assert path.at(-5.0) == path.at(5.0) == (10.0, 20.0, 3.0, 0.0)


def test_a_path_goes_through_all_its_waypoints():
    waypoints = [Waypoint(t, x, y) for t, x, y in [(0.0, 3.0, 1.0), (0.5, 9.0, -4.0), (2.0, 2.0, 2.0)]]
    path = Path(waypoints)
    for waypoint in waypoints:
        assert path.at(waypoint.time_s)[:2] == pytest.approx((waypoint.x, waypoint.y))


@pytest.mark.parametrize("times", [[], [1.0, 1.0], [0.0, 2.0, 1.0]])
def test_a_path_whose_times_do_not_increase_is_refused(times):
    with pytest.raises(SimulationError, match="increasing times"):
        Path([Waypoint(time_s, 0.0, 0.0) for time_s in times])


def test_a_background_of_another_size_is_refused():
    with pytest.raises(SimulationError, match="sensor of 64x48"):
        Scene(64, 48, 1.0, np.full((64, 48), GROUND), ())


@pytest.mark.parametrize("name", sorted(TEXTURES))
def test_textures_stay_between_dark_and_bright_use_that_range_and_follow_their_seed(name):
    first, again, other = (TEXTURES[name](np.random.default_rng(seed), 40, 52) for seed in (3, 3, 4))
    assert first.shape == (40, 52)
    assert first.min() == pytest.approx(DARK)
    assert first.max() == pytest.approx(BRIGHT)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_scene_without_light_is_refused():
    with pytest.raises(SimulationError, match="above 0"):
        Scene(8, 6, 1.0, np.zeros((6, 8)), ())


def test_an_unknown_sprite_is_named():
    with pytest.raises(SimulationError, match="no sprite 'moon'"):
        Scene(8, 6, 1.0, np.ones((6, 8)), ()).visible_share("moon", 0.0)
