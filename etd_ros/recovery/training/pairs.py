"""Pairs of an exemplar and a window to find it in, cut from simulated sequences, and made harder."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.recovery.compact import EXEMPLAR_SIDE, INSTANCE_SIDE
from etd_ros.recovery.crops import Crop, cut, exemplar_extent
from etd_ros.recovery.training.config import AugmentationConfig
from etd_ros.recovery.training.sequences import Sequence

EXEMPLAR_VISIBLE_MIN = 0.85
EXEMPLAR_DEVIATION_MIN = 6.0
"""Grey levels: a thing that has stood still has faded, there is nothing to remember."""
WINDOW_DEVIATION_MIN = 4.0
"""Grey levels: a thing that has faded more can neither be found nor told from its surroundings."""
HIDDEN_MAX = 0.1
"""Less of a thing in view counts as gone; it must not be found."""
SEEN_MIN = 0.5
"""More of it counts as seen; between both the place is left out of the loss."""
DRAWS_MAX = 50
BRIGHTNESS_LEVELS = 10.0
"""Standard deviation of the change of a crop's brightness (grey levels)."""


class Batch(NamedTuple):
    """Pairs.

    Attributes:
        exemplars: uint8, shape (n, exemplar_side, exemplar_side).
        sizes: width and height of the targets on the exemplars (pixels), float32, shape (n, 2).
        windows: uint8, shape (n, instance_side, instance_side).
        boxes: where the targets are on the windows, as centre x, y, width, height (pixels), float32, shape (n, 4);
            maybe beyond their borders.
        visible: share of each target that can be seen, float32, shape (n,).
    """

    exemplars: npt.NDArray[np.uint8]
    sizes: npt.NDArray[np.float32]
    windows: npt.NDArray[np.uint8]
    boxes: npt.NDArray[np.float32]
    visible: npt.NDArray[np.float32]


class Crops(NamedTuple):
    """What pairs of a network look like.

    Attributes:
        exemplar_side, instance_side: sides of an exemplar and of a window (pixels).
        follows_size: whether a window's scale is that of the target there, as a tracker's that follows its size, and
            not that of the exemplar, which is all that is known of a lost one.
    """

    exemplar_side: int
    instance_side: int
    follows_size: bool


COMPACT_CROPS = Crops(EXEMPLAR_SIDE, INSTANCE_SIDE, follows_size=False)


class _Pair(NamedTuple):
    exemplar: npt.NDArray[np.uint8]
    size: tuple[float, float]
    window: npt.NDArray[np.uint8]
    box: tuple[float, float, float, float]
    visible: float


class PairSampler:
    """A `Sampler`: draws batches of pairs.

    Args:
        sequences: a sequence by its seed.
        config: how pairs are made harder.
        crops: what they look like.
    """

    def __init__(
        self,
        sequences: Callable[[int], Sequence],
        config: AugmentationConfig | None = None,
        crops: Crops = COMPACT_CROPS,
    ) -> None:
        self._sequences = sequences
        self._config = config or AugmentationConfig()
        self._crops = crops

    def batch(self, rng: np.random.Generator, seeds: npt.NDArray[np.int64], count: int) -> Batch:
        """`count` pairs from the sequences of `seeds`, neighbours from different ones where there are several."""
        chosen = rng.permutation(np.resize(rng.permutation(seeds), max(count, len(seeds))))[:count]
        pairs = [self._pair(rng, int(seed), seeds) for seed in chosen]
        exemplars, sizes, windows, boxes, visible = zip(*pairs, strict=True)
        return Batch(
            np.array(exemplars),
            np.array(sizes, np.float32),
            np.array(windows),
            np.array(boxes, np.float32),
            np.array(visible, np.float32),
        )

    def _pair(self, rng: np.random.Generator, seed: int, seeds: npt.NDArray[np.int64]) -> _Pair:
        while True:
            sequence = self._sequences(seed)
            for _ in range(DRAWS_MAX):
                thing = int(rng.integers(sequence.boxes.shape[1]))
                clear = np.flatnonzero(sequence.visible[:, thing] >= EXEMPLAR_VISIBLE_MIN)
                if not len(clear):
                    continue
                first = int(rng.choice(clear))
                exemplar, size = self._exemplar(
                    rng, sequence.images[first], Box(*sequence.boxes[first, thing].tolist())
                )
                if exemplar.std() < EXEMPLAR_DEVIATION_MIN:
                    continue
                return self._with_window(rng, sequence, thing, first, exemplar, size)
            # Nothing in this sequence can be remembered.
            seed = int(rng.choice(seeds))

    def _exemplar(
        self, rng: np.random.Generator, image: npt.NDArray[np.uint8], box: Box
    ) -> tuple[npt.NDArray[np.uint8], tuple[float, float]]:
        """The crop round a box that is a little off, as a tracker's is, and the size it claims."""
        shift_x, shift_y, grow_w, grow_h = np.clip(rng.normal(0, self._config.box_noise, 4), -0.25, 0.25).tolist()
        w, h = box.w * np.exp(grow_w), box.h * np.exp(grow_h)
        center = box.center[0] + shift_x * box.w, box.center[1] + shift_y * box.h
        side = self._crops.exemplar_side
        scale = side / exemplar_extent(w, h)
        crop = cut(image, center, scale, (side, side))
        return crop.pixels, (w * scale, h * scale)

    def _with_window(
        self,
        rng: np.random.Generator,
        sequence: Sequence,
        thing: int,
        first: int,
        exemplar: npt.NDArray[np.uint8],
        size: tuple[float, float],
    ) -> _Pair:
        second = int(rng.integers(len(sequence.images)))
        # Of a lost target the scale is that of the remembered box; the target has changed its size meanwhile.
        known = Box(*sequence.boxes[second if self._crops.follows_size else first, thing].tolist())
        change = rng.uniform(-self._config.scale, self._config.scale)
        scale = self._crops.exemplar_side / exemplar_extent(known.w, known.h) * np.exp(change)
        target = Box(*sequence.boxes[second, thing].tolist())
        image = sequence.images[second]
        if rng.random() < self._config.elsewhere:
            center = self._elsewhere(rng, sequence, second, thing)
        else:
            reach = self._config.shift_px / scale
            center = target.center[0] + rng.uniform(-reach, reach), target.center[1] + rng.uniform(-reach, reach)
        crop = cut(image, center, scale, (self._crops.instance_side, self._crops.instance_side))
        visible = float(sequence.visible[second, thing])
        if _deviation(image, target) < WINDOW_DEVIATION_MIN:
            visible = min(visible, (HIDDEN_MAX + SEEN_MIN) / 2)
        return self._harder(rng, exemplar, size, crop, target, visible)

    def _elsewhere(self, rng: np.random.Generator, sequence: Sequence, second: int, thing: int) -> tuple[float, float]:
        """On another thing that may be taken for the target, or anywhere."""
        height, width = sequence.images.shape[1:]
        others = [other for other in range(sequence.boxes.shape[1]) if other != thing]
        if others and rng.random() < 0.7:
            column, row = Box(*sequence.boxes[second, int(rng.choice(others))].tolist()).center
            if 0 <= column < width and 0 <= row < height:
                return column, row
        return float(rng.uniform(0, width)), float(rng.uniform(0, height))

    def _harder(
        self,
        rng: np.random.Generator,
        exemplar: npt.NDArray[np.uint8],
        size: tuple[float, float],
        crop: Crop,
        target: Box,
        visible: float,
    ) -> _Pair:
        """Mirrored together, each with its own contrast and noise."""
        window = crop.pixels
        x, y, w, h = crop.of_box(target)
        if rng.random() < 0.5:
            exemplar, window, x = exemplar[:, ::-1], window[:, ::-1], len(window) - x
        if rng.random() < 0.25:
            exemplar, window, y = exemplar[::-1], window[::-1], len(window) - y
        if rng.random() < 0.25:
            exemplar, window, size = exemplar.T, window.T, (size[1], size[0])
            x, y, w, h = y, x, h, w
        return _Pair(self._regraded(rng, exemplar), size, self._regraded(rng, window), (x, y, w, h), visible)

    def _regraded(self, rng: np.random.Generator, crop: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        pixels = np.ascontiguousarray(crop, np.float32)
        if rng.random() < 0.2:
            pixels = np.asarray(cv2.GaussianBlur(pixels, (0, 0), rng.uniform(0.5, 1.5)), np.float32)
        mean = float(pixels.mean())
        gain = float(np.exp(rng.normal(0, self._config.gain)))
        graded = (pixels - mean) * gain + mean + rng.normal(0, BRIGHTNESS_LEVELS)
        if rng.random() < 0.5:
            noise = rng.standard_normal(pixels.shape, np.float32)
            graded = graded + noise * np.float32(rng.uniform(0, self._config.noise_levels))
        return np.asarray(np.clip(np.rint(graded), 0, 255), np.uint8)


def _deviation(image: npt.NDArray[np.uint8], box: Box) -> float:
    """Standard deviation of an image's pixels in a box (grey levels); 0 where the box is off the image."""
    left, top = max(0, int(box.x)), max(0, int(box.y))
    pixels = image[top : max(0, round(box.y + box.h)), left : max(0, round(box.x + box.w))]
    return float(pixels.std()) if pixels.size else 0.0
