"""What `etd-plus` makes of the recipes of the suite with other seeds.

    python docs/recipe_measures.py [FIRST LAST [RECIPE ...]]     # seeds, 1 and 4, and all recipes if none are given

Four minutes for three seeds of all 33 on two cores. Each line: a recipe, its targets, AP / AR, how many have an AR
below .5; then the same of all, occlusions survived (of up to 0.5 s, longer ones), wrong recoveries, and the longest
time from having left to a report of it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np
from seeded_scenes import seeds_asked_for

from etd_ros.evaluation.suite import TargetResult, evaluate
from etd_ros.simulation.suite import SUITE


def main() -> None:
    """Print the table."""
    names = sys.argv[3:] or list(SUITE)
    results: list[TargetResult] = []
    for name in names:
        recipes = [SUITE[name].with_seed(seed) for seed in seeds_asked_for(1, 4)]
        of_recipe = [result for targets in evaluate(recipes, jobs=2) for result in targets]
        _print(name, of_recipe)
        results += of_recipe
    _print("all", results)
    survived = f"{_sum(results, 'survived')} of {_sum(results, 'occlusions')}"
    longer = f"{_sum(results, 'longer_survived')} of {_sum(results, 'longer')}"
    wrong = f"{_sum(results, 'wrong_recoveries')} of {_sum(results, 'recoveries')}"
    left_s = max(result.left_s for result in results)
    sys.stdout.write(f"occlusions {survived}, longer {longer}; wrong recoveries {wrong}; left {left_s:.2f} s\n")


def _sum(results: Sequence[TargetResult], what: str) -> int:
    return sum(getattr(result, what) for result in results)


def _print(name: str, results: Sequence[TargetResult]) -> None:
    ap, ar = (np.mean([getattr(result, what) for result in results]) for what in ("ap", "ar"))
    low = sum(result.ar < 0.5 for result in results)
    sys.stdout.write(f"{name:14s} {len(results):4d}  {ap:.3f} / {ar:.3f}  {low}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
