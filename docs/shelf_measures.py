"""A camera slides past things at different depths, none of which changes its size: what `etd-plus` makes of them.

    python docs/shelf_measures.py [FIRST LAST [LATE_S]]    # seeds, 0 and 120 if none are given; when targets start, or
                                                           # as soon as they are seen; a minute for 60 on two cores

Pyramids, leaning books, mugs, towers, boxes and chess boards have few edges, many of them slanted, so that a look can
hardly tell moving along them from growing. Labels are those of `evaluate --suite`; some backgrounds are photographs
(extra `simulate`).
"""

from __future__ import annotations

import sys
from collections import defaultdict
from typing import Any

import numpy as np
from seeded_scenes import SeededScene, seeds_asked_for

from etd_ros.evaluation.suite import FIRST_LABEL_S, evaluate
from etd_ros.simulation import Scene, SensorConfig, shelf_scene

STREAM = 77
"""Beside the seed: no other list of scenes has these."""


def main() -> None:
    """Print the mean AP and AR of each kind of thing and of all."""
    shelves: Any = [Shelf(seed) for seed in seeds_asked_for(0, 120)]  # as far as `evaluate` asks, they are sequences
    late_s = float(sys.argv[3]) if len(sys.argv) > 3 else FIRST_LABEL_S
    results = [result for found in evaluate(shelves, jobs=2, first_label_s=late_s) for result in found]
    kinds = defaultdict(list)
    for result in results:
        kinds[result.target.rsplit("_", 1)[0]].append(result)
    for kind, of_kind in [*sorted(kinds.items()), ("all", results)]:
        ap, ar = (np.mean([getattr(result, figure) for result in of_kind]) for figure in ("ap", "ar"))
        sys.stdout.write(f"{kind:<12}{len(of_kind):>5}{ap:>8.3f}{ar:>8.3f}\n")
    ap = np.array([result.ap for result in results])
    sys.stdout.write(f"median AP {np.median(ap):.3f}; {np.count_nonzero(ap < 0.5)} below 0.5\n")


class Shelf(SeededScene):
    """Things that a camera slides past."""

    def make(self) -> tuple[Scene, SensorConfig]:
        return shelf_scene(np.random.default_rng([STREAM, self.seed]))


if __name__ == "__main__":
    main()
