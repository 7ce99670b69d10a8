"""Simulated sequences in a cache folder: images as recovery or a camera sees them, and the exact boxes on them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from etd_ros.events import concatenate
from etd_ros.output_files import make_folder
from etd_ros.reconstruction import HighPassFilter
from etd_ros.recovery.training.errors import TrainingError
from etd_ros.recovery.training.scenes import Situation, training_situation
from etd_ros.simulation import Scene, simulate, visible_shares
from etd_ros.simulation.motion import FloatArray
from etd_ros.simulation.scene import box_of

NS_PER_S = 1_000_000_000
FIRST_IMAGE_S = 0.25
"""Before that, too few events have come for a picture of the scene."""
IMAGE_S = (0.006, 0.024)
"""Shortest and longest time between images: ATSLTD frames end when they hold enough, not on a clock."""
RANDOM_STREAM = 4
"""Beside the seed: no seed makes a scene of another part of the project."""
OPEN_MAX = 500
"""Of a process's sequences; it may have 1024 files open on most systems."""


@dataclass(frozen=True, slots=True)
class Sequence:
    """Images of a scene with the boxes of everything that moves on its own.

    Attributes:
        images: reconstructed or filmed, uint8, shape (n, height, width).
        stamps_s: when (s since the start), float64, shape (n,).
        boxes: x, y, w, h of each thing on each image (pixels), float32, shape (n, things, 4).
        visible: share of each thing that can be seen, float32, shape (n, things).
    """

    images: npt.NDArray[np.uint8]
    stamps_s: npt.NDArray[np.float64]
    boxes: npt.NDArray[np.float32]
    visible: npt.NDArray[np.float32]


def simulated_sequence(seed: int) -> Sequence:
    """The sequence of a seed: scene, events, reconstruction at uneven stamps.

    Raises:
        SimulationError: scikit-image, whose photographs are used, is not installed.
    """
    rng = np.random.default_rng([RANDOM_STREAM, seed])
    return rendered(training_situation(rng), rng)


def rendered(situation: Situation, rng: np.random.Generator) -> Sequence:
    """What recovery gets to see of a scene; `rng` decides the sensor's noise and the stamps."""
    scene = situation.scene
    stamps_s = [FIRST_IMAGE_S]
    while stamps_s[-1] < scene.duration_s:
        stamps_s.append(stamps_s[-1] + rng.uniform(*IMAGE_S))
    stamps_s.pop()
    high_pass = HighPassFilter(scene.width, scene.height, situation.reconstruction)
    events = concatenate(list(simulate(scene, seed=int(rng.integers(2**31)), config=situation.sensor)))
    images, start_ns = [], 0
    for stamp_s in stamps_s:
        stamp_ns = round(stamp_s * NS_PER_S)
        high_pass.integrate(events.between(start_ns, stamp_ns))
        images.append(high_pass.image(stamp_ns).copy())
        start_ns = stamp_ns
    return Sequence(np.array(images), np.array(stamps_s), *truth_of(scene, np.array(stamps_s)))


def truth_of(scene: Scene, stamps_s: FloatArray) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Boxes and visible shares of a scene's targets at times (s, shape (n,)), as in `Sequence`."""
    things = [(index, sprite) for index, sprite in enumerate(scene.sprites) if sprite.is_target]
    placements = scene.placements(stamps_s)
    boxes = [[box_of(sprite, placed[1 + index]) for index, sprite in things] for placed in placements]
    visible = [visible_shares(scene, sprite.name, stamps_s).visible for _, sprite in things]
    return np.array(boxes, np.float32), np.array(visible, np.float32).T.copy()


class Pictures(NamedTuple):
    """A kind of sequences. Caches of several kinds may share a folder.

    Attributes:
        name, boxes_name: what the cache's files are called.
        simulate: makes the sequence of a seed; a function of a module, since another process calls it.
    """

    name: str
    boxes_name: str
    simulate: Callable[[int], Sequence]


RECONSTRUCTED = Pictures("images", "boxes", simulated_sequence)
"""What recovery sees; `video.VIDEO` is what a camera films."""


class SequenceCache:
    """A `Cache`: sequences by number in a folder, each made once; numbers are their seeds.

    Images stay in their files and are mapped into memory, so many more sequences fit than memory holds.
    """

    def __init__(self, folder: Path, pictures: Pictures = RECONSTRUCTED) -> None:
        self.folder, self.pictures = folder, pictures
        self._open: dict[int, Sequence] = {}

    def __reduce__(self) -> tuple[type[SequenceCache], tuple[Path, Pictures]]:
        """Another process opens the files itself."""
        return SequenceCache, (self.folder, self.pictures)

    def has(self, seed: int) -> bool:
        """Whether a sequence has been made."""
        return seed in self._open or self._boxes_path(seed).is_file()

    def make(self, seed: int) -> None:
        """Simulate a sequence unless it is there.

        Raises:
            OutputError: the folder cannot be made.
            TrainingError: the sequence cannot be written.
        """
        if self.has(seed):
            return
        make_folder(self.folder)
        sequence = self.pictures.simulate(seed)
        try:
            _write_beside(self._images_path(seed), sequence.images)
            boxes = np.concatenate([sequence.boxes, sequence.visible[..., None]], -1)
            stamps = np.broadcast_to(sequence.stamps_s[:, None, None], (*boxes.shape[:2], 1))
            # The boxes come last: where they are, the images are whole.
            _write_beside(self._boxes_path(seed), np.concatenate([boxes, stamps], -1))
        except OSError as err:
            msg = f"{self.folder}: a sequence cannot be written ({err.strerror or err}): make room or name another"
            raise TrainingError(msg) from err

    def sequence(self, seed: int) -> Sequence:
        """A sequence that has been made, its images mapped into memory.

        Raises:
            TrainingError: its files are missing or damaged.
        """
        if seed not in self._open:
            # Each holds a file open.
            if len(self._open) == OPEN_MAX:
                del self._open[next(iter(self._open))]
            self._open[seed] = self._load(seed)
        return self._open[seed]

    def _load(self, seed: int) -> Sequence:
        try:
            images = np.load(self._images_path(seed), mmap_mode="r", allow_pickle=False)
            rows = np.load(self._boxes_path(seed), allow_pickle=False)
        except (OSError, ValueError) as err:
            msg = f"{self._images_path(seed)}: sequence {seed} is missing or damaged: delete its files to make it anew"
            raise TrainingError(msg) from err
        if images.ndim != 3 or images.dtype != np.uint8 or rows.ndim != 3 or rows.shape[::2] != (len(images), 6):
            msg = f"{self._images_path(seed)}: not images and boxes of one sequence: delete both files"
            raise TrainingError(msg)
        numbers = rows.astype(np.float32)
        return Sequence(images, rows[:, 0, 5], numbers[..., :4], numbers[..., 4])

    def _images_path(self, seed: int) -> Path:
        return self.folder / f"{seed:07}.{self.pictures.name}.npy"

    def _boxes_path(self, seed: int) -> Path:
        return self.folder / f"{seed:07}.{self.pictures.boxes_name}.npy"


def _write_beside(path: Path, array: npt.NDArray[np.uint8] | npt.NDArray[np.float64]) -> None:
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with partial.open("wb") as file:
            np.save(file, array)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
