"""What `etd-plus` makes of what stands still before a camera that jolts: on a robot that brakes, or drives over bumps.

    python docs/jolt_measures.py [FIRST LAST]     # seeds, 0 and 12 if none are given; five minutes beside other work

The sheets are those of `handheld_measures`. The camera goes straight on at 30 to 200 px/s, comes to a halt within 0.02
to 0.15 s, shakes and stands for 0.8 s ("brakes"); or it goes to and fro and jolts three times ("bumps"). It shakes
along both axes, by up to 4 pixels, 8 to 30 times a second, for about 0.05 to 0.15 s. Each line: as there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from handheld_measures import DURATION_S, Handheld, Times, all_scenes, print_scenes
from seeded_scenes import seeds_asked_for

from etd_ros.simulation import Path

SPEED_PX_S, BRAKES_S = (30.0, 200.0), (0.02, 0.15)
BRAKES_AT_S, BUMPS_AT_S = 2.2, (0.8, 1.5, 2.2)
SHAKES_HZ, SHAKES_PX, SHAKES_S = (8.0, 30.0), (0.5, 4.0), (0.05, 0.15)
AREA_PX = 50.0
"""How far it goes to each side."""


@dataclass(frozen=True)
class Jolting(Handheld):
    """Things of one depth before a camera that jolts."""

    stream: ClassVar[int] = 96
    kinds: ClassVar[tuple[str, ...]] = ("brakes", "bumps")

    def _camera(self, rng: np.random.Generator) -> Path:
        speed_px_s = math.exp(rng.uniform(*np.log(SPEED_PX_S)))
        angle_rad, brakes_s = rng.uniform(0, 2 * math.pi), rng.uniform(*BRAKES_S)
        rates_hz, reaches_px = rng.uniform(*SHAKES_HZ, 2), rng.uniform(*SHAKES_PX, 2) * rng.choice((-1, 1), 2)
        fades_s = rng.uniform(*SHAKES_S)

        def way(t: Times) -> Times:
            if self.kind == "bumps":
                cycle = np.mod(speed_px_s * t / (4 * AREA_PX) + 0.1, 1)
                return np.asarray(AREA_PX * (1 - 4 * np.abs(cycle - 0.5)), np.float64)
            slowed_s = np.clip(t - BRAKES_AT_S, 0, brakes_s)
            driven_s = np.minimum(t, BRAKES_AT_S) - BRAKES_AT_S + slowed_s - slowed_s**2 / (2 * brakes_s)
            return np.asarray(np.maximum(speed_px_s * driven_s, -2 * AREA_PX), np.float64)

        def shaking(t: Times, axis: int) -> Times:
            since_s = [np.maximum(t - at_s, 0) for at_s in (BUMPS_AT_S if self.kind == "bumps" else (BRAKES_AT_S,))]
            waves = [np.sin(2 * np.pi * rates_hz[axis] * s) * np.exp(-s / fades_s) for s in since_s]
            return np.asarray(reaches_px[axis] * np.sum(waves, axis=0), np.float64)

        def pose(t: Times) -> tuple[Times, ...]:
            along = way(t)
            x, y = along * math.cos(angle_rad) + shaking(t, 0), along * math.sin(angle_rad) + shaking(t, 1)
            return x, y, np.ones_like(t), np.zeros_like(t)

        return Path.of(pose, DURATION_S)


def main() -> None:
    """Print the lines of all."""
    print_scenes(list(all_scenes(Jolting, seeds_asked_for(0, 12))))


if __name__ == "__main__":
    main()
