"""Things that others pass before, which nobody tracks, before a still camera for 10 s.

    python docs/passed_measures.py [FIRST LAST]     # seeds, 0 and 10 if none are given; two minutes on two cores

The things of `long_measures.py` that go round, swing, or stop and go on; from the third second on four larger ones of
40 to 100 px cross the sensor before them now and then, each within 2 to 5 s. The measures are those of that list; that
a box has an IoU below .3 while its target is said to be tracked counts from when half of it can be seen again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from long_measures import Long, print_all, seen_before
from seeded_scenes import seeds_asked_for

from etd_ros.simulation import Path, Scene, SensorConfig, Sprite
from etd_ros.simulation.motion import FloatArray

STREAM = 77
"""Beside the seed and the kind of motion: no other list of scenes has these."""
KINDS = "loops", "swings", "stops and goes"
PASSING, FIRST_S = 4, 2.0
AWAY_PX = -300.0


@dataclass(frozen=True)
class Passed(Long):
    """A scene of one kind of motion, with things that pass."""

    def make(self) -> tuple[Scene, SensorConfig]:
        scene, config = super().make()
        rng = np.random.default_rng([STREAM, self.seed, len(self.kind)])
        passing = [self._passing(rng, f"passing_{number}", scene) for number in range(PASSING)]
        return replace(scene, sprites=(*scene.sprites, *passing)), config

    def _passing(self, rng: np.random.Generator, name: str, scene: Scene) -> Sprite:
        size_px, period_s = int(rng.integers(40, 100)), rng.uniform(2, 5)
        phase, row = rng.uniform(0, 1), rng.uniform(20, 160)
        thing = seen_before(np.asarray(scene.background), rng, size_px)

        def pose(t: FloatArray) -> tuple[FloatArray, ...]:
            turns = (t - FIRST_S) / period_s - phase
            across = turns % 3
            x = (across * (scene.width + 2 * size_px)) - size_px
            return np.where((turns > 0) & (across < 1), x, AWAY_PX), np.full_like(t, row)

        return Sprite(name, *thing, Path.of(pose, scene.duration_s), is_target=False)


def main() -> None:
    """Print the measures of the scenes that are asked for."""
    print_all((Passed(seed, kind) for seed in seeds_asked_for(0, 10) for kind in KINDS), KINDS)


if __name__ == "__main__":
    main()
