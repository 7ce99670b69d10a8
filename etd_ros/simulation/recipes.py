"""Recipes of scenes, and the scenes made from them: the fixed suite and random scenes differ in their recipes only."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import Flicker, FloatArray, Path, SimulationError
from etd_ros.simulation.motions import (
    Area,
    Track,
    crosses,
    leaves,
    rests,
    shakes,
    slides,
    swings,
    wanders,
)
from etd_ros.simulation.scene import Scene, Sprite
from etd_ros.simulation.sensor import SensorConfig
from etd_ros.simulation.textures import BRIGHT, DARK, Texture, smooth_noise
from etd_ros.simulation.things import KINDS, Thing, rim_seen

MOTIONS = ("wander", "cross", "rest")
CAMERAS = ("still", "slide", "shake", "wander", "zoom")
STAYS_AWAY = math.inf
SENSOR = SensorConfig(step_s=0.005, step_px=0.6)
MARGIN_PX = 3.0
GREY = 0.45
"""Contrast is compressed towards this intensity."""
DARK_LIGHT = 0.04
CAMERA_ZOOM = (1.0, 1.35)
SHAKE_HZ_MEAN = 3.0
PANEL_SPEED_PX_S = 280.0
RIM_CONTRAST_MIN, RIM_SHARE_MIN = 0.3, 0.35
"""Of log intensity: an edge of less makes hardly an event; and for how much of the rim."""
TRIALS = 12
COVERS_MAX = 2
TURNS_S = (0.3, 0.8)
"""How long leaving or coming back takes."""


@dataclass(frozen=True, slots=True)
class Recipe:
    """What a scene holds and tests.

    Attributes:
        kinds: of the targets, in turn (things.KINDS).
        background: one of BACKGROUNDS.
        targets: how many.
        size_px: smallest and largest larger side of a target (pixels).
        speed_px_s: smallest and largest root mean square speed of a target on the sensor (pixels/s).
        motion: one of MOTIONS; what rests stands in the world, past which the camera moves.
        scale: how far targets shrink and grow while they move.
        spin_deg_s: how fast they turn.
        camera: one of CAMERAS.
        camera_px_s: its speed (pixels/s).
        occlusion_s: for how long each of the first two targets is hidden in full; 0: it is not.
        leaves_s: when each target starts to leave, as a share of the duration; 0: it stays.
        away_s: until it starts to come back (s); STAYS_AWAY.
        look_alikes: things that look like the first target.
        flicker_hz, flicker_depth: of the light, or of a lamp among the things where `kinds` has one.
        contrast: exponent of the intensities; below 1 compresses them.
        gradient: brightest over darkest light on the scene.
        duration_s: how long it lasts.
        sensor: what sees it.
    """

    kinds: tuple[str, ...]
    background: str
    targets: int = 1
    size_px: tuple[float, float] = (30.0, 50.0)
    speed_px_s: tuple[float, float] = (100.0, 200.0)
    motion: str = "wander"
    scale: tuple[float, float] = (1.0, 1.0)
    spin_deg_s: float = 0.0
    camera: str = "still"
    camera_px_s: float = 0.0
    occlusion_s: float = 0.0
    leaves_s: float = 0.0
    away_s: float = STAYS_AWAY
    look_alikes: int = 0
    flicker_hz: float = 0.0
    flicker_depth: float = 0.1
    contrast: float = 1.0
    gradient: float = 1.0
    duration_s: float = 1.5
    sensor: SensorConfig = field(default=SENSOR)

    def __post_init__(self) -> None:
        choices = ((self.motion, MOTIONS), (self.camera, CAMERAS), (self.background, tuple(BACKGROUNDS)))
        for value, known in (*choices, *((kind, tuple(KINDS)) for kind in self.kinds)):
            if value not in known:
                msg = f"unknown {value!r} in a recipe: choose one of {', '.join(known)}"
                raise SimulationError(msg)


def make_scene(recipe: Recipe, width: int, height: int, rng: np.random.Generator) -> Scene:
    """A scene after a recipe, for a sensor of width x height pixels; the generator decides what is left open."""
    return _Maker(recipe, width, height, rng).scene()


class _Maker:
    def __init__(self, recipe: Recipe, width: int, height: int, rng: np.random.Generator) -> None:
        self._recipe, self._width, self._height, self._rng = recipe, width, height, rng
        self._times = np.linspace(0, recipe.duration_s, 200)
        self._camera = self._camera_track()
        self._background = self._make_background()

    def scene(self) -> Scene:
        recipe = self._recipe
        things = self._things()
        tracks = [self._track(thing, area) for thing, area in zip(things, self._areas(things), strict=True)]
        targets = [
            self._sprite(f"{kind}_{number}", thing, track)
            for number, (kind, thing, track) in enumerate(
                zip(_cycled(recipe.kinds, recipe.targets), things, tracks, strict=False), 1
            )
        ]
        twins = [
            self._sprite(f"look_alike_{number}", thing, track, is_target=False)
            for number, (thing, track) in enumerate(
                zip(things[recipe.targets :], tracks[recipe.targets :], strict=True), 1
            )
        ]
        covers = []
        if recipe.occlusion_s > 0:
            covers = [
                self._cover(f"cover_{number}", thing, track)
                for number, (thing, track) in enumerate(
                    zip(things[: min(recipe.targets, COVERS_MAX)], tracks, strict=False), 1
                )
            ]
        has_lamp = "lamp" in recipe.kinds
        return Scene(
            self._width,
            self._height,
            recipe.duration_s,
            self._background,
            (*twins, *targets, *covers),
            view=self._view(),
            flicker=Flicker(recipe.flicker_hz, recipe.flicker_depth) if recipe.flicker_hz and not has_lamp else None,
            shade=self._shade() if recipe.gradient > 1 else None,
            dark=DARK_LIGHT if recipe.gradient > 1 else 0.0,
        )

    def _things(self) -> list[Thing]:
        """The targets' textures, then those of the look-alikes."""
        things = []
        for kind in _cycled(self._recipe.kinds, self._recipe.targets):
            low, high = np.log(self._recipe.size_px)
            size = max(6, round(float(np.exp(self._rng.uniform(low, high)))))
            things.append(self._thing(kind, size))
        for _ in range(self._recipe.look_alikes):
            texture, opacity = things[0]
            things.append((np.clip(texture * self._rng.uniform(0.93, 1.07), DARK / 2, BRIGHT * 1.1), opacity))
        return things

    def _thing(self, kind: str, size: int) -> Thing:
        """A thing whose rim can be told from the background, if one turns up within a few trials."""
        ground = float(np.log(self._background).mean())
        for _ in range(TRIALS):
            texture, opacity = KINDS[kind](self._rng, size)
            texture = self._compressed(texture)
            if rim_seen((texture, opacity), ground, RIM_CONTRAST_MIN * self._recipe.contrast) > RIM_SHARE_MIN:
                break
        return texture, opacity

    def _areas(self, things: list[Thing]) -> list[Area]:
        """A part of the sensor for each thing's centre; the parts overlap a little."""
        count = len(things)
        columns = max(1, min(count, round(math.sqrt(count * self._width / self._height))))
        rows = -(-count // columns)
        order = self._rng.permutation(rows * columns)[:count]
        cell_width, cell_height = self._width / columns, self._height / rows
        areas = []
        for (texture, _), cell in zip(things, order, strict=True):
            row, column = divmod(int(cell), columns)
            half = max(texture.shape) * self._recipe.scale[1] / 2 + MARGIN_PX
            x, y = (column + 0.5) * cell_width, (row + 0.5) * cell_height
            if self._recipe.motion == "cross":
                x, reach_x = self._width / 2, max(self._width / 2 - half, 0.5)
            else:
                reach_x = max(0.6 * cell_width - half, 0.25 * cell_width)
            reach_y = max(0.6 * cell_height - half, 0.25 * cell_height)
            areas.append(
                Area(
                    *np.maximum((x - reach_x, y - reach_y), np.minimum((half, half), (x, y))).tolist(),
                    *np.minimum(
                        (x + reach_x, y + reach_y), np.maximum((self._width - half, self._height - half), (x, y))
                    ).tolist(),
                )
            )
        return areas

    def _track(self, thing: Thing, area: Area) -> Track:
        """Where a thing's centre is on the sensor, or, if it rests, in the world."""
        recipe, rng = self._recipe, self._rng
        speed = float(np.exp(rng.uniform(*np.log(recipe.speed_px_s))))
        if recipe.motion == "rest":
            return rests(*self._resting_place(thing, area))
        if recipe.motion == "cross":
            track = crosses(rng, area, speed, recipe.duration_s)
        else:
            track = wanders(rng, area, speed)
        return self._leaving(track, thing) if recipe.leaves_s > 0 else track

    def _resting_place(self, thing: Thing, area: Area) -> tuple[float, float]:
        """A place in the world that the camera sees for as long as it can."""
        half = max(thing[0].shape) / 2 + MARGIN_PX
        camera_x, camera_y = self._camera(self._times)
        x, y = (
            float(np.clip(self._rng.uniform(low, high), size_low, size_high)) if size_low < size_high else middle
            for low, high, size_low, size_high, middle in (
                (area.left, area.right, half + camera_x.max(), self._width - half + camera_x.min(), self._width / 2),
                (area.top, area.bottom, half + camera_y.max(), self._height - half + camera_y.min(), self._height / 2),
            )
        )
        return x, y

    def _leaving(self, track: Track, thing: Thing) -> Track:
        recipe = self._recipe
        half = 0.75 * max(thing[0].shape) * recipe.scale[1]
        leave_s = recipe.leaves_s * recipe.duration_s
        turn_s = self._rng.uniform(*TURNS_S)
        back_s = None if math.isinf(recipe.away_s) else leave_s + turn_s + recipe.away_s
        x, _ = track(self._times[self._times >= leave_s])
        to_left = x[0] < self._width / 2
        shift = -(x.max() + half) if to_left else self._width - x.min() + half
        return leaves(track, leave_s, back_s, (float(shift), 0.0), turn_s)

    def _sprite(self, name: str, thing: Thing, track: Track, *, is_target: bool = True) -> Sprite:
        recipe, rng = self._recipe, self._rng
        scale = _constant(1.0) if recipe.scale == (1.0, 1.0) else swings(rng, *recipe.scale, recipe.duration_s)
        spin = math.radians(recipe.spin_deg_s) * rng.choice([-1.0, 1.0]) * rng.uniform(0.7, 1.0)
        path = self._in_world(track, scale, lambda times: spin * times)
        is_lamp = name.startswith("lamp") and recipe.flicker_hz > 0
        flicker = Flicker(recipe.flicker_hz, recipe.flicker_depth) if is_lamp else None
        return Sprite(name, *thing, path, is_target=is_target, flicker=flicker)

    def _cover(self, name: str, thing: Thing, track: Track) -> Sprite:
        """Something that hides a thing in full: a pillar that one crosses behind, or a panel that passes by."""
        recipe, rng = self._recipe, self._rng
        half_s = recipe.occlusion_s / 2
        middle_s = rng.uniform(0.4, 0.6) * recipe.duration_s
        hidden = np.linspace(middle_s - half_s, middle_s + half_s, 40)
        if recipe.motion == "rest":
            track = self._as_seen(track)
        x, y = track(hidden)
        x0, y0 = (float(values[len(values) // 2]) for values in (x, y))
        velocity = 0.0
        if recipe.motion != "cross":
            # Against the target's own way, or it would stay with the target.
            velocity = -math.copysign(PANEL_SPEED_PX_S, x[-1] - x[0])
        half = 0.5 * math.hypot(*thing[0].shape) if recipe.spin_deg_s else 0.0
        half_height, half_width = (max(half, extent / 2) * recipe.scale[1] for extent in thing[0].shape)
        reach_x = np.abs(x - x0 - velocity * (hidden - middle_s)).max() + half_width + 1
        reach_y = np.abs(y - y0).max() + half_height * rng.uniform(1.1, 1.4) + 2
        shape = (math.ceil(2 * reach_y), math.ceil(2 * reach_x))
        texture = rng.uniform(0.3, 0.6) + 0.25 * (smooth_noise(rng, *shape, grain=3.0) - 0.5)

        def straight(times: FloatArray) -> tuple[FloatArray, FloatArray]:
            return x0 + velocity * (times - middle_s), np.full_like(times, y0)

        path = self._in_world(straight, _constant(1.0), _constant(0.0), is_seen=True)
        return Sprite(name, self._compressed(np.clip(texture, DARK, BRIGHT)), np.ones(shape), path, is_target=False)

    def _in_world(
        self,
        track: Track,
        scale: Callable[[FloatArray], FloatArray],
        angle: Callable[[FloatArray], FloatArray],
        *,
        is_seen: bool = False,
    ) -> Path:
        """A path in the world of what has a track on the sensor; what rests has one in the world already."""
        rests_in_world = self._recipe.motion == "rest" and not is_seen

        def pose(times: FloatArray) -> tuple[FloatArray, ...]:
            x, y = track(times)
            shift_x, shift_y = (np.zeros_like(times),) * 2 if rests_in_world else self._camera(times)
            return x + shift_x, y + shift_y, scale(times), angle(times)

        return Path.of(pose, self._recipe.duration_s)

    def _as_seen(self, track: Track) -> Track:
        def seen(times: FloatArray) -> tuple[FloatArray, FloatArray]:
            (x, y), (shift_x, shift_y) = track(times), self._camera(times)
            return x - shift_x, y - shift_y

        return seen

    def _camera_track(self) -> Track:
        recipe, rng = self._recipe, self._rng
        if recipe.camera == "slide":
            return slides(rng, recipe.camera_px_s, recipe.duration_s)
        if recipe.camera == "shake":
            return shakes(rng, recipe.camera_px_s / (2 * np.pi * SHAKE_HZ_MEAN))
        if recipe.camera in ("wander", "zoom") and recipe.camera_px_s > 0:
            reach_x, reach_y = self._width / 3, self._height / 3
            return wanders(rng, Area(-reach_x, -reach_y, reach_x, reach_y), recipe.camera_px_s)
        return rests(0.0, 0.0)

    def _view(self) -> Path | None:
        if self._recipe.camera == "still":
            return None
        zoom = _constant(1.0)
        if self._recipe.camera == "zoom":
            zoom = swings(self._rng, *CAMERA_ZOOM, self._recipe.duration_s)
        return Path.of(lambda times: (*self._camera(times), zoom(times)), self._recipe.duration_s)

    def _make_background(self) -> Texture:
        x, y = self._camera(self._times)
        width, height = (
            extent + 2 * math.ceil(float(np.abs(way).max())) for extent, way in ((self._width, x), (self._height, y))
        )
        return self._compressed(BACKGROUNDS[self._recipe.background](self._rng, height, width))

    def _compressed(self, texture: Texture) -> Texture:
        return np.asarray(GREY * (texture / GREY) ** self._recipe.contrast, np.float64)

    def _shade(self) -> FloatArray:
        """Light that falls off over the scene, geometrically."""
        angle = self._rng.uniform(0, 2 * np.pi)
        y, x = np.mgrid[-0.5 : 0.5 : self._height * 1j, -0.5 : 0.5 : self._width * 1j]
        along = x * np.cos(angle) + y * np.sin(angle)
        share = (along - along.min()) / (along.max() - along.min())
        return np.asarray(self._recipe.gradient**-share, np.float64)


def _cycled(kinds: tuple[str, ...], count: int) -> list[str]:
    return [kinds[number % len(kinds)] for number in range(count)]


def _constant(value: float) -> Callable[[FloatArray], FloatArray]:
    return lambda times: np.full_like(times, value)
