"""Things that stay before a still camera for 10 s, as they do before one that is left running.

    python docs/long_measures.py [FIRST LAST]     # seeds, 0 and 8 if none are given; two minutes on two cores

In each scene two things of 24 to 44 px go round on loops of their own, bounce off the sensor's borders, swing, stop and
go on, or go behind pillars again and again, at 240x180 pixels; one passes before the other now and then. All turn back,
none turns or grows, and all stand out from the wall behind them. For each kind of motion: AP / AR over all labels (50 a
second, while half of the thing can be seen), the mean IoU of the first and of the last two seconds, and for how much of
the labelled time a target is said to be tracked where its box has an IoU below .3. Both start where they are clear of
each other.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from seeded_scenes import SeededScene, seeds_asked_for, tracked_all

from etd_ros.boxes import Box
from etd_ros.evaluation.scoring import SUCCESS_IOU, label_overlaps
from etd_ros.evaluation.suite import START_NS, of_each
from etd_ros.evaluation.truth import TimedBox
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, things, true_boxes
from etd_ros.simulation.backgrounds import wall
from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.recipes import RIM_CONTRAST_MIN, RIM_SHARE_MIN
from etd_ros.simulation.things import Thing, rim_seen
from etd_ros.targets import TargetStart
from etd_ros.tracking import TargetState

STREAM = 131
"""Beside the seed: no other list of scenes has these."""
WIDTH, HEIGHT, DURATION_S = 240, 180, 10.0
LABEL_S, STARTS_S, END_S = 0.02, 0.04, 2.0
ELSEWHERE_IOU, CLEAR_TIMES = 0.3, 1.2
THINGS = things.ball, things.dartboard, things.irregular, things.plain, things.car

Way = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def _loops(rng: np.random.Generator) -> Way:
    """Round the middle, at two rates that do not go together."""
    (rate_x, rate_y), (phase_x, phase_y) = rng.uniform(1.2, 2.2, 2), rng.uniform(0, 2 * np.pi, 2)
    return lambda t: (np.cos(rate_x * t + phase_x), np.sin(rate_y * t + phase_y))


def _bounces(rng: np.random.Generator) -> Way:
    """Straight on, and back at once at the borders."""
    (period_x, period_y), (phase_x, phase_y) = rng.uniform(1.5, 3.5, 2), rng.uniform(0, 1, 2)
    return lambda t: (_to_and_fro(t / period_x + phase_x), _to_and_fro(t / period_y + phase_y))


def _swings(rng: np.random.Generator) -> Way:
    """On an arc, as a pendulum."""
    rate, phase, width = rng.uniform(2, 4), rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 1)
    return lambda t: (width * np.sin(rate * t + phase), 2.5 * np.cos(0.9 * width * np.sin(rate * t + phase)) - 1.6)


def _stops_and_goes(rng: np.random.Generator) -> Way:
    """From place to place within .7 s, where it stands for .8 s."""
    places = rng.uniform(-1, 1, (2, 9))

    def way(t: FloatArray) -> tuple[FloatArray, FloatArray]:
        at = np.clip((t + 0.6) / 1.5, 0, 7.999)
        part = np.clip((at % 1) * 1.5 / 0.7, 0, 1)
        before, after = places[:, at.astype(int)], places[:, at.astype(int) + 1]
        x, y = before + part**2 * (3 - 2 * part) * (after - before)
        return x, y

    return way


def _to_and_fro(turns: FloatArray) -> FloatArray:
    return np.asarray(4 * np.abs(turns % 1 - 0.5) - 1)


WAYS = {
    "loops": _loops,
    "bounces": _bounces,
    "swings": _swings,
    "stops and goes": _stops_and_goes,
    "loops behind pillars": _loops,
}


@dataclass(frozen=True)
class Long(SeededScene):
    """A scene of one kind of motion."""

    kind: str

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng([STREAM, list(WAYS).index(self.kind), self.seed])
        background = wall(rng, HEIGHT, WIDTH)
        sprites = [self._thing(rng, name, background) for name in ("first", "second")]
        if "pillars" in self.kind:
            sprites += [_pillar(rng, f"pillar_{x}", x) for x in (75, 165)]
        scene = Scene(WIDTH, HEIGHT, DURATION_S, background, tuple(sprites))
        return scene, SensorConfig(noise_rate_hz=2000.0, step_px=0.6)

    def _thing(self, rng: np.random.Generator, name: str, background: FloatArray) -> Sprite:
        size_px = int(rng.integers(24, 45))
        thing = seen_before(background, rng, size_px)
        way = WAYS[self.kind](rng)
        reach_x, reach_y = WIDTH / 2 - size_px, HEIGHT / 2 - size_px

        def pose(t: FloatArray) -> tuple[FloatArray, ...]:
            x, y = way(t)
            return WIDTH / 2 + reach_x * x, HEIGHT / 2 + reach_y * y

        return Sprite(name, *thing, Path.of(pose, DURATION_S))


def seen_before(background: FloatArray, rng: np.random.Generator, size_px: int) -> Thing:
    """A thing whose rim can be told from the background."""
    ground = float(np.log(background).mean())
    while True:
        thing = THINGS[rng.integers(len(THINGS))](rng, size_px)
        if rim_seen(thing, ground, RIM_CONTRAST_MIN) > RIM_SHARE_MIN:
            return thing


def _pillar(rng: np.random.Generator, name: str, x: int) -> Sprite:
    texture = np.full((HEIGHT, 24), float(rng.uniform(0.1, 0.9)))

    def stands(t: FloatArray) -> tuple[FloatArray, ...]:
        return np.full_like(t, x), np.full_like(t, HEIGHT / 2)

    return Sprite(name, texture, np.ones_like(texture), Path.of(stands, DURATION_S), is_target=False)


def _clear_from(boxes: dict[float, Box], others: dict[float, Box]) -> float:
    """The first time (s) at which two things can be seen with room between them."""
    return next(
        time_s
        for time_s, box in boxes.items()
        if time_s in others and box.scaled(CLEAR_TIMES).iou(others[time_s].scaled(CLEAR_TIMES)) == 0
    )


def measures_of(long: Long) -> tuple[str, list[tuple[float, ...]]]:
    """The kind of motion, and for each target AP, AR, mean IoU at first and at last, and how much is said wrongly."""
    scene = long.scene()
    seen = {
        name: dict(true_boxes(scene, name, np.arange(STARTS_S, scene.duration_s, LABEL_S))) for name in scene.targets
    }
    clear_s = _clear_from(*seen.values())
    truths = {
        name: [TimedBox(START_NS + round(time_s * 1e9), box) for time_s, box in boxes.items() if time_s >= clear_s]
        for name, boxes in seen.items()
    }
    starts = [TargetStart(name, truth[0].box, truth[0].stamp_ns) for name, truth in truths.items()]
    rows = tracked_all(long, starts)
    found = []
    for name, truth in truths.items():
        labels, own = truth[1:], [row for row in rows if row.target == name]
        stamps = np.array([row.stamp_ns for row in own])
        answers = np.searchsorted(stamps, [label.stamp_ns for label in labels], "right") - 1
        is_tracked = np.array([own[answer].state == TargetState.TRACKING.value for answer in answers.clip(0)])
        overlaps = np.array(label_overlaps(own, labels))
        is_wrong = is_tracked & (overlaps < ELSEWHERE_IOU)
        times_s = np.array([label.stamp_ns - START_NS for label in labels]) * 1e-9
        first, last = (overlaps[part].mean() for part in (times_s < END_S, times_s >= DURATION_S - END_S))
        found.append((overlaps.mean(), (overlaps >= SUCCESS_IOU).mean(), first, last, is_wrong.mean()))
    return long.kind, found


def print_all(longs: Iterable[Long], kinds: Sequence[str]) -> None:
    """Print the measures of each kind of motion and of all."""
    measures = defaultdict(list)
    for kind, found in of_each(measures_of, longs, jobs=2):
        measures[kind] += found
        measures["all"] += found
    for kind in (*kinds, "all"):
        ap, ar, first, last, wrong = np.mean(measures[kind], axis=0)
        sys.stdout.write(
            f"{kind:22s} {len(measures[kind]):3d}  {ap:.3f}/{ar:.3f}  at first {first:.3f}, at last {last:.3f}, "
            f"said wrongly {wrong:.3f}\n"
        )


def main() -> None:
    """Print the measures of the scenes that are asked for."""
    print_all((Long(seed, kind) for seed in seeds_asked_for(0, 8) for kind in WAYS), tuple(WAYS))


if __name__ == "__main__":
    main()
