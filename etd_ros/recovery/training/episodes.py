"""Losses to recover from: simulated sequences that training never sees, with and without their target coming back."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.reconstruction import HighPassConfig
from etd_ros.recovery.training.scenes import Situation
from etd_ros.recovery.training.sequences import Sequence, rendered
from etd_ros.simulation import random_sequence

FIRST_SEED = 50_000
EPISODE_STREAM = 7
SENSOR_SIZES = ((240, 180), (240, 180), (346, 260))
DURATION_S = 1.8
LOSS_S = (0.7, 1.1)
"""When a target that nothing hides is lost."""
BLIND_S = (0.0, 0.25)
"""How long it is not looked for after that: a tracker notices late, or the target is out of sight."""
SEEN_MIN, HIDDEN_MAX = 0.5, 0.25
REMEMBERED_SHARE_MIN = 0.7
IMAGES_MIN = 10
"""A target that can be seen on fewer images before the loss, or after it, makes no episode."""


@dataclass(frozen=True, slots=True)
class Episode:
    """One loss.

    Attributes:
        name: says which.
        sequence: what recovery is shown; of an episode in which the target is gone, without it from the loss on.
        target: its index in `sequence`.
        lost: image of the loss: the tracker was right on those before.
        first: the first image that is searched.
        returns: whether the target can be seen after the loss.
    """

    name: str
    sequence: Sequence
    target: int
    lost: int
    first: int
    returns: bool

    @property
    def last_box(self) -> Box:
        """Where the tracker saw the target last."""
        return self.box(max(0, self.lost - 1))

    def box(self, image: int) -> Box:
        """The target's true box."""
        return Box(*self.sequence.boxes[image, self.target].tolist())


def episodes(count: int, *, first_seed: int = FIRST_SEED) -> Iterator[Episode]:
    """Two episodes for each of `count` seeds at most: the target comes back, and it has gone for good.

    Raises:
        SimulationError: scikit-image, whose photographs are used, is not installed.
    """
    for seed in range(first_seed, first_seed + count):
        yield from _episodes_of(seed)


def _episodes_of(seed: int) -> Iterator[Episode]:
    rng = np.random.default_rng([EPISODE_STREAM, seed])
    width, height = SENSOR_SIZES[seed % len(SENSOR_SIZES)]
    simulated = random_sequence(seed, width, height, duration_s=DURATION_S, photographs=True)
    situation = Situation(simulated.scene(), simulated.recipe.sensor, HighPassConfig())
    noise = int(rng.integers(2**31))
    sequence = rendered(situation, np.random.default_rng(noise))
    targets = rng.permutation(sequence.boxes.shape[1])
    loss = next((loss for target in targets if (loss := _loss(rng, sequence, int(target)))), None)
    if loss is None:
        return
    target, lost, first = loss
    yield Episode(f"{simulated.name} back", sequence, target, lost, first, True)
    # The same scene without the target, from the loss on; its look-alikes stay.
    name = situation.scene.targets[target]
    sprites = tuple(sprite for sprite in situation.scene.sprites if sprite.name != name)
    empty = dataclasses.replace(situation, scene=dataclasses.replace(situation.scene, sprites=sprites))
    without = rendered(empty, np.random.default_rng(noise))
    images = np.concatenate([sequence.images[:first], without.images[first:]])
    visible = sequence.visible.copy()
    visible[first:, target] = 0
    gone = dataclasses.replace(sequence, images=images, visible=visible)
    yield Episode(f"{simulated.name} gone", gone, target, lost, first, False)


def _loss(rng: np.random.Generator, sequence: Sequence, target: int) -> tuple[int, int, int] | None:
    """Target, image of the loss, first image searched; None where too little of the target is seen."""
    seen = sequence.visible[:, target]
    settled = int(np.searchsorted(sequence.stamps_s, LOSS_S[0] / 2))
    hidden = np.flatnonzero(seen[settled:] < HIDDEN_MAX)
    if len(hidden):
        first = settled + int(hidden[0])
        # The tracker fails while the target disappears.
        clear = np.flatnonzero(seen[:first] >= REMEMBERED_SHARE_MIN)
        lost = int(clear[-1]) + 1 if len(clear) else 0
    else:
        lost = int(np.searchsorted(sequence.stamps_s, rng.uniform(*LOSS_S)))
        first = int(np.searchsorted(sequence.stamps_s, sequence.stamps_s[lost] + rng.uniform(*BLIND_S)))
    before = int(np.count_nonzero(seen[:lost] >= REMEMBERED_SHARE_MIN))
    after = int(np.count_nonzero(seen[first:] >= SEEN_MIN))
    return (target, lost, first) if min(before, after) >= IMAGES_MIN else None
