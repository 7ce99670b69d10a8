"""What `etd-plus` makes of everyday trouble before a still camera: what stops, sets off, turns round, is told late,
comes nearer or goes away.

    python docs/everyday_measures.py     # a minute

A checked square before a smooth wall, a sensor of 240x180 pixels with noise. Each line: mean IoU of the boxes in the
time that counts (a target without a box has 0), and how many of the scenes have .5 on average.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from seeded_scenes import SeededScene, mean_overlap, print_overlaps

from etd_ros.simulation import Path, Scene, SensorConfig, Sprite
from etd_ros.simulation.textures import checks, smooth_noise

WIDTH, HEIGHT, CELL_PX = 240, 180, 9

Times = npt.NDArray[np.float64]
Way = Callable[[Times], Times]
"""How far along its direction a thing is from the sensor's middle (pixels) at times (s)."""


@dataclass(frozen=True)
class Trouble(SeededScene):
    """A square on a straight way.

    Attributes:
        kind: what it is an example of.
        way: its motion.
        size_px: its side.
        size: its size at times (s), in parts of that.
        is_disc: whether it is a bright disc instead, which has no texture.
        duration_s: of the scene.
        starts_s, late_s: the time of its start box, and how much later tracking begins.
        counts_s: from when on boxes count.
        noise_rate_hz: events/s of the sensor's noise.
    """

    kind: str = ""
    way: Way = np.zeros_like
    size_px: int = 36
    duration_s: float = 1.0
    starts_s: float = 0.02
    late_s: float = 0.0
    size: Way = np.ones_like
    is_disc: bool = False
    counts_s: float = 0.0
    noise_rate_hz: float = 1000.0

    def make(self) -> tuple[Scene, SensorConfig]:
        rng = np.random.default_rng(self.seed)
        angle_rad = rng.uniform(0, 2 * math.pi)
        wall = 0.5 + 0.05 * smooth_noise(rng, HEIGHT, WIDTH)
        square = checks(rng, self.size_px, self.size_px, cell=CELL_PX)
        across, down = math.cos(angle_rad), math.sin(angle_rad)
        path = Path.of(
            lambda t: (WIDTH / 2 + across * self.way(t), HEIGHT / 2 + down * self.way(t), self.size(t)), self.duration_s
        )
        texture, opacity = (
            (np.full_like(square, 0.9), _disc(self.size_px)) if self.is_disc else (square, np.ones_like(square))
        )
        thing = Sprite("thing", texture, opacity, path)
        scene = Scene(WIDTH, HEIGHT, self.duration_s, wall, (thing,))
        return scene, SensorConfig(noise_rate_hz=self.noise_rate_hz)


def _disc(size_px: int) -> npt.NDArray[np.float64]:
    """1 where a disc of this diameter (pixels) covers its square."""
    rows, columns = np.mgrid[:size_px, :size_px] - (size_px - 1) / 2
    return np.asarray(np.hypot(columns, rows) < size_px / 2, np.float64)


def stops() -> Iterator[Trouble]:
    """What brakes, and stands for 0.6 s."""
    for speed, brakes_s, noise, size in itertools.product((40, 150), (0.03, 0.3), (1e3, 5e3, 2e4, 5e4), (24, 60)):
        until_s = min(0.6, 60 / speed)

        def way(t: Times, speed: float = speed, brakes_s: float = brakes_s, until_s: float = until_s) -> Times:
            slowed_s = np.clip(t - until_s, 0, brakes_s)
            return speed * (np.minimum(t, until_s) - until_s + slowed_s - slowed_s**2 / (2 * brakes_s))

        end_s = until_s + brakes_s + 0.6
        kind = f"stops, {noise:,.0f} events/s of noise"
        yield Trouble(0, kind, way, size, end_s, counts_s=end_s - 0.4, noise_rate_hz=noise)


def sets_off() -> Iterator[Trouble]:
    """What rests in its start box before it moves."""
    for speed, rests_s, size, seed in itertools.product((40, 120, 300), (0.1, 0.3, 1.0), (24, 40), range(2)):

        def way(t: Times, speed: float = speed, rests_s: float = rests_s) -> Times:
            return speed * np.clip(t - rests_s, 0, None) - speed * 0.1

        kind = f"rests for {rests_s} s, sets off at {speed} px/s"
        yield Trouble(seed, kind, way, size, rests_s + 0.25, counts_s=rests_s + 0.15)


def turns_round() -> Iterator[Trouble]:
    """What turns back at once."""
    for speed, seed in itertools.product((60, 150, 300, 600), range(4)):
        turns_s = 80 / speed

        def way(t: Times, speed: float = speed, turns_s: float = turns_s) -> Times:
            return 40 - speed * np.abs(t - turns_s)

        yield Trouble(seed, f"turns back at {speed} px/s", way, 36, 2 * turns_s, counts_s=1.5 * turns_s)


def comes_late() -> Iterator[Trouble]:
    """What has moved on before its box came."""
    for speed, late_s, size, seed in itertools.product((30, 80, 150), (0.1, 0.2, 0.3), (24, 40), range(2)):

        def way(t: Times, speed: float = speed) -> Times:
            return speed * (t - 0.45)

        kind = f"box {late_s} s old, {speed} px/s"
        yield Trouble(seed, kind, way, size, 0.9, starts_s=0.1, late_s=late_s, counts_s=late_s + 0.3)


def comes_nearer() -> Iterator[Trouble]:
    """What would touch the camera after a time, until it is three times as near; and the same backwards."""
    for touches_s, goes_away, is_disc, speed, seed in itertools.product(
        (0.7, 1.5, 3.0), (False, True), (False, True), (0, 15), range(2)
    ):
        duration_s = touches_s * 2 / 3

        def since_s(t: Times, goes_away: bool = goes_away, duration_s: float = duration_s) -> Times:
            return duration_s - t if goes_away else t

        def size(t: Times, since_s: Way = since_s, touches_s: float = touches_s) -> Times:
            return 1 / (1 - np.clip(since_s(t), 0, 0.7 * touches_s) / touches_s)

        def way(t: Times, since_s: Way = since_s, size: Way = size, speed: float = speed) -> Times:
            return speed * since_s(t) * size(t)

        kind = f"{'goes away from' if goes_away else 'comes as near as'} {touches_s} s"
        yield Trouble(seed, kind, way, 22, duration_s, size=size, is_disc=is_disc, counts_s=duration_s / 2)


def main() -> None:
    """Print a line for each kind."""
    troubles = [*stops(), *sets_off(), *turns_round(), *comes_late(), *comes_nearer()]
    found: dict[str, list[float]] = {}
    for trouble in troubles:
        overlap = mean_overlap(trouble, trouble.starts_s, trouble.counts_s, trouble.late_s)
        found.setdefault(trouble.kind, []).append(overlap)
    print_overlaps(found)


if __name__ == "__main__":
    main()
