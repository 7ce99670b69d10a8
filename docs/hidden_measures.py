"""What `etd-plus` makes of what goes behind something, leaves, or is passed by another target, before a still camera.

    python docs/hidden_measures.py     # two minutes

Things before walls, a sensor of 240x180 pixels with noise. Each line: mean IoU while half of a target can be seen; how
many of those of which less than a tenth can be seen are said to be lost within .2 s; how many have an IoU of .5 at the
end, if they can be seen then; seconds for which boxes were wrong (IoU below .3 for longer than .2 s, seen or not).
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from seeded_scenes import SeededScene

from etd_ros.engine import track
from etd_ros.evaluation.scoring import SUCCESS_IOU
from etd_ros.evaluation.suite import START_NS
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.simulation.things import ball, car
from etd_ros.simulation.truth import visible_shares
from etd_ros.stream import StreamGuard
from etd_ros.targets import TargetStart
from etd_ros.tracking import TargetState

WIDTH, HEIGHT, ROW = 240, 180, 90.0
START_S, GRID_S, END_S, TOLD_S = 0.05, 0.01, 0.2, 0.2
SEEN, GONE = 0.5, 0.1
WRONG_IOU = 0.3

Floats = npt.NDArray[np.float64]
Way = Callable[[Floats], tuple[Floats, Floats]]
"""Where a thing's middle is at times (s)."""


def along(*points: tuple[float, float]) -> Way:
    """Along a row through these (time, column), each motion beginning and ending within 60 ms."""
    times, columns = zip(*points, strict=True)
    steps = np.linspace(-0.03, 0.03, 7)
    return lambda t: (np.mean([np.interp(t + step, times, columns) for step in steps], axis=0), np.full_like(t, ROW))


def at_speed(speed: float, column: float, time_s: float, row: float = ROW) -> Way:
    """Along a row, at a column at a time."""
    return lambda t: (column + speed * (t - time_s), np.full_like(t, row))


@dataclass(frozen=True)
class Hidden(SeededScene):
    """Something on its way.

    Attributes:
        kind: what it is an example of.
        way: its motion.
        size_px: its side.
        duration_s: of the scene.
        cover_px: the width of what stands before it in the middle; 0: nothing does.
        other: the motion, and the side in pixels, of another target, which passes before it.
        is_alike: whether that one looks the same.
    """

    kind: str
    way: Way
    size_px: int
    duration_s: float
    cover_px: int = 0
    other: tuple[Way, int] | None = None
    is_alike: bool = False

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng(self.seed)
        is_clouded = self.seed // 2 % 2 == 1 and self.other is None
        clouds = smooth_noise(rng, HEIGHT, WIDTH)
        wall = 0.25 + 0.4 * clouds if is_clouded else 0.5 + 0.05 * clouds
        me = self._sprite("thing", *self._thing(rng), self.way)
        sprites = [me]
        if self.other is not None:
            way, size_px = self.other
            texture = checks(rng, size_px, size_px, cell=max(4, size_px // 4))
            surface = me.texture if self.is_alike else texture
            sprites.append(self._sprite("other", surface, np.ones(surface.shape), way))
        if self.cover_px:
            tone = rng.choice([0.2, 0.85]) + 0.1 * (smooth_noise(rng, HEIGHT, self.cover_px) - 0.5)
            path = Path.of(at_speed(0, WIDTH / 2, 0), self.duration_s)
            sprites.append(Sprite("cover", tone, np.ones(tone.shape), path, is_target=False))
        return Scene(WIDTH, HEIGHT, self.duration_s, wall, tuple(sprites)), SensorConfig(step_px=0.6)

    def _thing(self, rng: np.random.Generator) -> tuple[Floats, Floats]:
        if self.other is None and self.seed % 3:
            return (ball, car)[self.seed % 3 - 1](rng, self.size_px)
        texture = checks(rng, self.size_px, self.size_px, cell=max(4, self.size_px // 4))
        return texture, np.ones(texture.shape)

    def _sprite(self, name: str, texture: Floats, opacity: Floats, way: Way) -> Sprite:
        return Sprite(name, texture, opacity, Path.of(lambda t: way(np.asarray(t, float)), self.duration_s))


@dataclass(frozen=True)
class Outcome:
    """What became of a target; None: it was not to be said lost, or cannot be seen at the end."""

    overlap: float
    is_told: bool | None
    is_found: bool | None
    wrong_s: float


def outcomes(hidden: Hidden) -> Iterator[Outcome]:
    """Of each target of a scene."""
    scene = hidden.scene()
    names = [sprite.name for sprite in scene.sprites if sprite.is_target]
    guard = StreamGuard()
    events = (batch for part in hidden.events(scene, start_ns=START_NS) for batch in guard.feed(part))
    starts = [TargetStart(name, scene.box(name, START_S), START_NS + round(START_S * 1e9)) for name in names]
    reports = [(step.frame.stamp_ns, step.reports) for step in track(events, starts, threads=False)]
    stamps = np.array([stamp_ns for stamp_ns, _ in reports])
    times = np.arange(START_S + 2 * GRID_S, hidden.duration_s, GRID_S)
    frames = np.searchsorted(stamps, START_NS + np.round(times * 1e9), side="right") - 1
    for number, name in enumerate(names):
        said = [reports[frame][1][number] for frame in frames]
        boxes = [(report.box, scene.box(name, time)) for report, time in zip(said, times, strict=True)]
        overlaps = np.array([0.0 if box is None else box.iou(truth) for box, truth in boxes])
        is_tracked = np.array([report.state is TargetState.TRACKING for report in said])
        visible = visible_shares(scene, name, times).visible
        gone = np.flatnonzero(visible < GONE)
        told = slice(gone[0], gone[0] + round(TOLD_S / GRID_S) + 1) if len(gone) else None
        end = slice(-round(END_S / GRID_S), None)
        yield Outcome(
            float(overlaps[visible >= SEEN].mean()),
            None if told is None else not is_tracked[told].all(),
            float(np.median(overlaps[end])) >= SUCCESS_IOU if visible[end].min() >= SEEN else None,
            wrong_s(is_tracked & (overlaps < WRONG_IOU)),
        )


def wrong_s(is_wrong: npt.NDArray[np.bool_]) -> float:
    """How long wrong boxes lasted that lasted long."""
    spans = (len(list(span)) * GRID_S for wrong, span in itertools.groupby(is_wrong) if wrong)
    return sum(span for span in spans if span > TOLD_S)


def goes_behind() -> Iterator[Hidden]:
    """What passes behind a pole or a wall, turns back there, or stays."""
    for speed, hidden_px in itertools.product((60, 120, 240), (10, 24, 40)):
        yield Hidden(0, "passes behind a pole", at_speed(speed, 25, 0), 28, 180 / speed, hidden_px + 28)
    for speed, hidden_s in itertools.product((40, 80, 120), (0.5, 1.0)):
        cover_px = round(speed * hidden_s) + 26
        yield Hidden(0, "behind a wall for .5 or 1 s", at_speed(speed, 20, 0), 26, 200 / speed, cover_px)
    for speed, hidden_s in itertools.product((60, 150), (0.2, 0.5, 1.0)):
        in_s, deep = 70 / speed, 100 + min(6, speed * 0.05)
        out_s = in_s + hidden_s
        end_s = out_s + 60 / speed
        way = along((0, 30), (in_s, 100), (in_s + 0.08, deep), (out_s - 0.05, deep), (out_s, 100), (end_s, 40))
        yield Hidden(0, "turns back behind a wall", way, 28, end_s, 68)
    for speed, _ in itertools.product((60, 150, 300), range(2)):
        way = along((0, 30), (90 / speed, 120), (9, 120))
        yield Hidden(0, "goes behind a wall and stays", way, 28, 90 / speed + 2, 80)


def comes_in(speed: float, out_s: float, in_s: float) -> Way:
    """Out at the right until a time, in at the left from another one on; it stays about there."""

    def way(t: Floats) -> tuple[Floats, Floats]:
        stays_s = np.clip(t - in_s - 100 / speed, 0, None)
        inside = np.minimum(-15 + speed * (t - in_s), 85) + 12.5 * (1 - np.cos(5 * stays_s))
        return np.where(t < (out_s + in_s) / 2, 110 + speed * t, inside), ROW + 25 * np.sin(5 * stays_s)

    return way


def goes_over_the_border() -> Iterator[Hidden]:
    """What stops half over the border, or comes in at the other side."""
    for speed, rest_s in itertools.product((60, 150), (0.5, 1.5, 3.0)):
        back_s = 106 / speed + rest_s
        way = along((0, 130), (106 / speed, 236), (back_s, 236), (back_s + 90 / speed, 146), (99, 146))
        yield Hidden(0, "stops half over the border, comes back", way, 32, back_s + 90 / speed + 0.2)
    for speed, away_s in itertools.product((80, 200), (0.5, 2.0, 5.0)):
        in_s = 145 / speed + away_s
        way = comes_in(speed, 145 / speed, in_s)
        yield Hidden(0, "leaves, comes in at the other side", way, 30, in_s + 100 / speed + 1.5)


def cross() -> Iterator[Hidden]:
    """Two targets, one of which passes before the other."""
    speeds, sizes = ((60, -60), (120, -40), (150, 30), (100, -100)), ((34, 34), (30, 42))
    for alike, (speed, other), (size, other_size), apart in itertools.product((True, False), speeds, sizes, (0, 7)):
        is_alike = alike and size == other_size
        duration_s = 170 / abs(speed - other)
        way, other_way = (
            at_speed(v, WIDTH / 2, duration_s / 2, ROW + y) for v, y in ((speed, -apart / 2), (other, apart / 2))
        )
        kind = f"two that cross, {'alike' if is_alike else 'different'}"
        yield Hidden(0, kind, way, size, duration_s, other=(other_way, other_size), is_alike=is_alike)


def main() -> None:
    """Print a line for each kind."""
    made = itertools.chain(goes_behind(), goes_over_the_border(), cross())
    found: dict[str, list[Outcome]] = {}
    for seed, hidden in enumerate(made):
        found.setdefault(hidden.kind, []).extend(outcomes(replace(hidden, seed=seed)))
    for kind, results in found.items():
        overlap, wrong = np.mean([result.overlap for result in results]), sum(result.wrong_s for result in results)
        told, ends = ([getattr(result, what) for result in results] for what in ("is_told", "is_found"))
        sys.stdout.write(f"{kind:40s} {overlap:.3f}  lost {share(told)}  end {share(ends)}  wrong {wrong:5.1f} s\n")


def share(answers: list[bool | None]) -> str:
    """How many of those that count are so."""
    return f"{answers.count(True):2d} of {len(answers) - answers.count(None):2d}"


if __name__ == "__main__":
    main()
