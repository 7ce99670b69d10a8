"""Rotation, moving cameras, light, and the tiles that are painted again: against what a picture must show."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.simulation import Absence, Flicker, Path, Scene, SimulationError, Sprite, Waypoint, absent_times
from etd_ros.simulation.rendering import Renderer

WIDTH, HEIGHT = 64, 48
GROUND, FRONT = 0.2, 0.8


def still(x: float, y: float, scale: float = 1.0, angle: float = 0.0) -> Path:
    return Path([Waypoint(0.0, x, y, scale, angle)])


def sheet(path: Path, size: tuple[int, int] = (12, 20), **options) -> Sprite:
    return Sprite(options.pop("name", "thing"), np.full(size, FRONT), np.ones(size), path, **options)


def scene_of(*sprites: Sprite, background: np.ndarray | None = None, **options) -> Scene:
    ground = np.full((HEIGHT, WIDTH), GROUND) if background is None else background
    return Scene(WIDTH, HEIGHT, 1.0, ground, sprites, **options)


def covered(scene: Scene, time_s: float = 0.0) -> np.ndarray:
    return (np.exp(scene.render(time_s)) - GROUND) / (FRONT - GROUND) > 0.5


@settings(deadline=None, max_examples=40)
@given(
    x=st.floats(26, 38),
    y=st.floats(20, 28),
    scale=st.floats(0.6, 1.2),
    angle=st.floats(-7, 7),
    zoom=st.floats(0.8, 1.2),
)
def test_a_box_is_tight_on_a_turned_thing_before_a_zoomed_camera(x, y, scale, angle, zoom):
    thing = sheet(still(x, y, scale, angle))
    scene = scene_of(thing, view=Path([Waypoint(0.0, 2.0, -1.0, zoom, 0.3)]))
    rows, columns = np.nonzero(covered(scene))
    box = scene.box("thing", 0.0)
    # A corner of a turned rectangle is narrower than a pixel.
    assert box.x - 0.51 <= columns.min() <= box.x + 1.8
    assert box.y - 0.51 <= rows.min() <= box.y + 1.8
    assert box.x + box.w - 1.8 <= columns.max() + 1 <= box.x + box.w + 0.51
    assert box.y + box.h - 1.8 <= rows.max() + 1 <= box.y + box.h + 0.51


def test_a_quarter_turn_exchanges_width_and_height():
    box = scene_of(sheet(still(32.0, 24.0, 1.0, np.pi / 2))).box("thing", 0.0)
    assert tuple(box) == pytest.approx((26.0, 14.0, 12.0, 20.0))


def test_transparent_margins_do_not_belong_to_the_box():
    opacity = np.zeros((12, 20))
    opacity[3:9, 5:12] = 1.0
    opacity[9, 5:12] = 0.4
    scene = scene_of(Sprite("thing", np.full((12, 20), FRONT), opacity, still(32.0, 24.0)))
    assert tuple(scene.box("thing", 0.0)) == pytest.approx((22 + 5, 18 + 3, 7, 6))


def test_the_background_shifts_against_the_camera_and_things_with_it_by_their_nearness():
    rng = np.random.default_rng(1)
    wall = rng.uniform(0.2, 0.8, (HEIGHT, WIDTH + 20))
    things = [
        sheet(still(32.0, 24.0), name="far", nearness=1.0), sheet(still(32.0, 24.0), name="near", nearness=2.0)
    ]  # fmt: skip
    scene = scene_of(*things, background=wall, view=Path([Waypoint(0.0, 5.0, 0.0)]))
    assert np.exp(scene.render(0.0))[:10] == pytest.approx(wall[:10, 15:79])
    assert scene.box("far", 0.0).x == pytest.approx(22 - 5)
    assert scene.box("near", 0.0).x == pytest.approx(22 - 10)


def test_the_background_continues_mirrored():
    wall = np.random.default_rng(1).uniform(0.2, 0.8, (HEIGHT, WIDTH))
    image = np.exp(scene_of(background=wall, view=Path([Waypoint(0.0, 200.0, 0.0)])).render(0.0))
    columns = np.arange(200, 200 + WIDTH) % (2 * WIDTH)
    assert image == pytest.approx(wall[:, np.where(columns < WIDTH, columns, 2 * WIDTH - 1 - columns)])


def test_flicker_changes_all_the_light_and_a_lamps_only_its_own():
    quarter_s = 0.25 / 50
    room = scene_of(sheet(still(32.0, 24.0)), flicker=Flicker(50.0, 0.1))
    assert room.render(quarter_s) - room.render(0.0) == pytest.approx(np.log(1.1))
    lamp = scene_of(sheet(still(32.0, 24.0), flicker=Flicker(50.0, 0.1)))
    change = lamp.render(quarter_s) - lamp.render(0.0)
    assert change[24, 32] == pytest.approx(np.log(1.1))
    assert change[2, 2] == 0


def test_the_dark_takes_contrast_where_there_is_little_light():
    shade = np.ones((HEIGHT, WIDTH))
    shade[:, 32:] = 0.05
    image = scene_of(sheet(still(32.0, 24.0)), shade=shade, dark=0.05).render(0.0)
    assert image[24, 28] - image[2, 28] == pytest.approx(np.log((FRONT + 0.05) / (GROUND + 0.05)))
    assert image[24, 36] - image[2, 36] == pytest.approx(np.log((0.05 * FRONT + 0.05) / (0.05 * GROUND + 0.05)))


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), moves_camera=st.booleans())
def test_painting_only_what_has_changed_gives_the_whole_picture(seed, moves_camera):
    rng = np.random.default_rng(seed)
    things = [
        Sprite(
            f"thing_{number}", rng.uniform(0.2, 1, (9, 14)), rng.uniform(0, 1, (9, 14)).round(),
            Path(
                [Waypoint(0.0, *rng.uniform(0, 60, 2)), Waypoint(1.0, *rng.uniform(0, 60, 2), 1.4, float(rng.normal()))]
            ),
        )
        for number in range(3)
    ]  # fmt: skip
    view = Path([Waypoint(0.0, 0, 0), Waypoint(1.0, 9, 4, 1.1, 0.1)]) if moves_camera else None
    scene = scene_of(*things, background=rng.uniform(0.2, 1, (HEIGHT, WIDTH)), view=view)
    times = np.array([0.0, 0.1, 0.35, 0.35, 0.9, 1.0, 1.5])
    renderer = Renderer(scene, times)
    for number, time_s in enumerate(times):
        before = renderer.after.copy()
        renderer.advance(number)
        assert np.array_equal(renderer.after, scene.render(time_s))
        if number:
            assert np.array_equal(renderer.before, before)
            tiles = np.kron(renderer.changed, np.ones((16, 16), bool))[:HEIGHT, :WIDTH]
            assert np.array_equal(renderer.after[~tiles], renderer.before[~tiles])


@settings(deadline=None, max_examples=40)
@given(st.lists(st.floats(1e-6, 1e6), min_size=WIDTH, max_size=WIDTH))
def test_logarithms_are_exact_to_rounding(values):
    row = np.array(values)
    image = scene_of(background=np.repeat(row[None], HEIGHT, axis=0)).render(0.0)
    assert image[7] == pytest.approx(np.log(row), rel=1e-15, abs=4e-16)


def test_absences_are_told_apart_by_their_reason():
    crossing = Path([Waypoint(0.0, 10, 24), Waypoint(0.5, 32, 24), Waypoint(1.0, 120, 24)])
    cover = sheet(still(32.0, 24.0), (20, 24), name="cover", is_target=False)
    occluded, left = absent_times(scene_of(sheet(crossing, (8, 8)), cover), "thing")
    assert (occluded.reason, left.reason) == (Absence.OCCLUDED, Absence.LEFT)
    times = np.arange(0, 1.0, 0.005)
    x = crossing.poses(times)[:, 0]
    hidden = times[(x >= 22) & (x <= 42)]
    assert occluded.start_s == pytest.approx(hidden[0], abs=0.006)
    assert occluded.end_s == pytest.approx(hidden[-1], abs=0.011)
    assert left.start_s == pytest.approx(times[x >= WIDTH + 4][0], abs=0.011)
    assert left.end_s == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Flicker(0.0, 0.1), "rate above 0"),
        (lambda: Flicker(100.0, 1.0), "depth in"),
        (lambda: Sprite("ghost", np.ones((4, 4)), np.zeros((4, 4)), still(0, 0)), "nowhere opaque"),
        (lambda: Sprite("odd", np.ones((4, 4)), np.ones((4, 5)), still(0, 0)), "with an opacity of"),
        (lambda: scene_of(shade=np.ones((3, 3))), "a shade of"),
        (lambda: scene_of(shade=np.zeros((HEIGHT, WIDTH))), "above 0"),
        (lambda: scene_of(sheet(still(0, 0)), sheet(still(9, 9))), "two sprites of one name"),
    ],
)
def test_what_cannot_be_simulated_is_refused(build, message):
    with pytest.raises(SimulationError, match=message):
        build()
