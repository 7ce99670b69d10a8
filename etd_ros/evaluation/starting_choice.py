"""Finds the weights of the object round a click: on simulated scenes, whose truth is exact.

`python -m etd_ros.evaluation.starting_choice --random 230 --shelves 80 --seed 100` prints those of `PointedObject`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, starmap

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize

from etd_ros.boxes import ious
from etd_ros.engine import track
from etd_ros.evaluation.starting import CLICK_MEMORY_S, CLICK_PLACES, CLICK_TIMES_S, WELL_SEEN, Things, on_sensor
from etd_ros.evaluation.suite import NS_PER_S, START_NS
from etd_ros.events import Events, concatenate
from etd_ros.simulation import Scene, random_sequences, shelf_scene, simulate
from etd_ros.stream import StreamGuard
from etd_ros.tracking.click_candidates import FEATURES
from etd_ros.tracking.discovery import Discovery
from etd_ros.tracking.pointed_object import LOOKS, PointedObject

Float64Array = npt.NDArray[np.float64]

POOR_IOU, GOOD_IOU = 0.4, 0.8
"""A candidate is worth 0 up to this IoU with the truth, 1 from that one on."""
USEFUL_IOU = 0.5
"""A look tells which candidate to choose if its best has this IoU."""
SHELF_STREAM = 78
"""Beside the seed: no list of scenes that is measured has these."""
DECAY = 0.01
"""Weight of the squares of the standardised weights."""


@dataclass(frozen=True, slots=True)
class Example:
    """The candidates of one look.

    Attributes:
        features: float64, shape (n, len(FEATURES)).
        worth: of each candidate, 0 to 1, float64, shape (n,).
    """

    features: Float64Array
    worth: Float64Array


def examples(scene: Scene, events: Events) -> Iterator[Example]:
    """The looks at the clicks of one scene, whose events these are, that have a good candidate: those of
    `evaluate --start`."""
    things = Things(scene)
    frames = [(step.frame.stamp_ns, step.frame.data) for step in track(StreamGuard().feed(events), [], threads=False)]
    for time_s in CLICK_TIMES_S:
        clicked_ns = START_NS + round(time_s * NS_PER_S)
        clicks = [
            (name, PointedObject(box.center[0] + place[0] * box.w, box.center[1] + place[1] * box.h, clicked_ns))
            for name, box in things.boxes(clicked_ns, WELL_SEEN).items()
            if name in things.first_ns
            for place in CLICK_PLACES
        ]
        discovery, looks = Discovery(scene.width, scene.height), 0
        for stamp_ns, frame in frames:
            if looks == LOOKS or stamp_ns < clicked_ns - CLICK_MEMORY_S * NS_PER_S:
                continue
            discovery.take(stamp_ns, frame)
            if stamp_ns < clicked_ns or not discovery.is_due():
                continue
            discovery.look(thorough=True)
            looks += 1
            truth = things.boxes(stamp_ns)
            for name, pointed in clicks:
                found = pointed.candidates(discovery)
                if found is None or name not in truth:
                    continue
                overlaps = ious(found.boxes, np.array([on_sensor(truth[name], scene)], np.float64))[:, 0]
                if overlaps.max(initial=0.0) >= USEFUL_IOU:
                    yield Example(found.features, np.clip((overlaps - POOR_IOU) / (GOOD_IOU - POOR_IOU), 0.0, 1.0))


def random_scenes(seeds: Iterable[int]) -> Iterator[tuple[Scene, Events]]:
    """Random scenes and their events."""
    for sequence in random_sequences(seeds):
        scene = sequence.scene()
        yield scene, concatenate(list(sequence.events(scene, start_ns=START_NS)))


def shelf_scenes(seeds: Iterable[int]) -> Iterator[tuple[Scene, Events]]:
    """Things at different depths that a camera slides past, and their events."""
    for seed in seeds:
        scene, sensor = shelf_scene(np.random.default_rng([SHELF_STREAM, seed]))
        yield scene, concatenate(list(simulate(scene, seed=seed, start_ns=START_NS, config=sensor)))


def fitted_weights(of_looks: Iterable[Example]) -> Float64Array:
    """The weights with which a softmax over the candidates is worth the most (mean logarithm), shape (len(FEATURES),).

    Args:
        of_looks: at least one.
    """
    looks = list(of_looks)
    features, worth = np.concatenate([look.features for look in looks]), np.concatenate([look.worth for look in looks])
    spread = features.std(axis=0) + 1e-6
    scaled = (features - features.mean(axis=0)) / spread
    sizes = [len(look.worth) for look in looks]
    starts, of_look = np.cumsum([0, *sizes[:-1]]), np.repeat(np.arange(len(looks)), sizes)

    def loss(weights: Float64Array) -> tuple[float, Float64Array]:
        scores = scaled @ weights
        chances = np.exp(scores - np.maximum.reduceat(scores, starts)[of_look])
        chances /= np.add.reduceat(chances, starts)[of_look]
        expected = np.add.reduceat(chances * worth, starts)
        gradient = scaled.T @ (chances - chances * worth / expected[of_look]) / len(looks)
        return float(DECAY * weights @ weights - np.log(expected).mean()), gradient + 2 * DECAY * weights

    found = minimize(loss, np.zeros(features.shape[1]), jac=True, method="L-BFGS-B")
    return np.asarray(found.x / spread, np.float64)


def main() -> None:
    """Print the weights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--random", type=int, default=230, help="how many random scenes")
    parser.add_argument("--shelves", type=int, default=80, help="how many scenes that a camera slides past")
    parser.add_argument("--seed", type=int, default=100, help="of the first ones")
    options = parser.parse_args()
    random_seeds, shelf_seeds = (range(options.seed, options.seed + n) for n in (options.random, options.shelves))
    scenes = chain(random_scenes(random_seeds), shelf_scenes(shelf_seeds))
    weights = fitted_weights(chain.from_iterable(starmap(examples, scenes)))
    sys.stdout.writelines(f'"{name}": {weight:.2f},\n' for name, weight in zip(FEATURES, weights, strict=True))


if __name__ == "__main__":
    main()
