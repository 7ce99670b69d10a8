"""The network that tells how far a target's box is off, in NumPy and Numba: torch is for its training only."""

from __future__ import annotations

import zipfile
import zlib
from functools import cache
from pathlib import Path
from tokenize import TokenError
from typing import NamedTuple

import numpy as np
from numba import njit

from etd_ros.tracking.box_view import CELLS, NUMBERS, BoxView
from etd_ros.tracking.contour_kernels import Float32Array
from etd_ros.tracking.errors import TrackingError

UNREADABLE = (
    OSError, ValueError, KeyError, EOFError, TypeError, RuntimeError, SyntaxError, TokenError, zipfile.BadZipFile,
    zlib.error,
)  # fmt: skip
"""What NumPy makes of archives that are damaged in one way or another."""
WEIGHTS = Path(__file__).parent / "weights" / "box.npz"
LAYERS = ((11, 24, 2), (24, 32, 1), (32, 48, 2), (48, 48, 1), (48, 64, 2))
"""Channels in and out, and steps, of the convolutions: 3 x 3, each with a ReLU after it."""
HIDDEN = 64
OFFSET_UNIT, SPREAD_UNIT = 0.3, -2.5
"""What an output of 1 is as an offset, and of 0 as the logarithm of a spread."""
SPREAD_LIMITS = -5.0, 1.0


class BoxMisfit(NamedTuple):
    """How far a box is off.

    Attributes:
        offsets: of the true middle along x and y, in parts of the box's width and height, and the logarithm of the true
            width and height in parts of them; float32, shape (4,).
        spreads: how far each of these may be off itself (the mean absolute error), float32, shape (4,).
    """

    offsets: Float32Array
    spreads: Float32Array


class BoxNetwork:
    """Convolutions over what is seen round a box, and two layers that read off them how far it is off.

    Args:
        weights: by the names of `weight_shapes`, float32.
    """

    def __init__(self, weights: dict[str, Float32Array]) -> None:
        count = range(len(LAYERS))
        self._kernels = [weights[f"convolution_{number}"].reshape(LAYERS[number][1], -1) for number in count]
        self._biases = [weights[f"convolution_{number}_bias"] for number in count]
        self._hidden, self._hidden_bias = weights["hidden"], weights["hidden_bias"]
        self._output, self._output_bias = weights["output"], weights["output_bias"]

    def misfit_of(self, view: BoxView) -> BoxMisfit:
        """How far the box of a view is off."""
        return self.misfit(*view.drawn(view.box, view.velocity))

    def misfit(self, maps: Float32Array, numbers: Float32Array) -> BoxMisfit:
        """How far off the box is round which this was drawn, as `BoxView.drawn` returns it."""
        layer = maps
        for (_, _, step), kernels, biases in zip(LAYERS, self._kernels, self._biases, strict=True):
            layer = convolve(layer, kernels, biases, step)
        hidden = self._hidden @ np.concatenate([layer.ravel(), numbers]) + self._hidden_bias
        output = self._output @ np.maximum(hidden, 0) + self._output_bias
        offsets, spreads = np.split(output, 2)
        return BoxMisfit(offsets * np.float32(OFFSET_UNIT), np.exp(np.clip(spreads + SPREAD_UNIT, *SPREAD_LIMITS)))


def weight_shapes() -> dict[str, tuple[int, ...]]:
    """The shapes of the network's weights by their names."""
    shapes: dict[str, tuple[int, ...]] = {}
    cells = CELLS
    for number, (before, after, step) in enumerate(LAYERS):
        shapes |= {f"convolution_{number}": (after, before, 3, 3), f"convolution_{number}_bias": (after,)}
        cells //= step
    seen = LAYERS[-1][1] * cells * cells + NUMBERS
    return shapes | {"hidden": (HIDDEN, seen), "hidden_bias": (HIDDEN,), "output": (8, HIDDEN), "output_bias": (8,)}


@cache
def shipped_network() -> BoxNetwork:
    """The network whose weights ship."""
    return load_box_network(WEIGHTS)


def load_box_network(path: Path) -> BoxNetwork:
    """The network with the weights of a file.

    Raises:
        TrackingError: as `read_weights`.
    """
    return BoxNetwork(read_weights(path))


def read_weights(path: Path) -> dict[str, Float32Array]:
    """The weights of a file, by the names of `weight_shapes`.

    Raises:
        TrackingError: the file cannot be read, or holds no weights of this network.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            weights = {name: file[name].astype(np.float32) for name in weight_shapes()}
    except UNREADABLE as err:
        msg = f"{path}: no weights of the box network ({_reason(err)}): name a box.npz made by `train --network box`"
        raise TrackingError(msg) from err
    for name, shape in weight_shapes().items():
        if weights[name].shape != shape or not np.isfinite(weights[name]).all():
            msg = f"{path}: weights {name} are not numbers of shape {shape}"
            raise TrackingError(msg)
    return weights


def _reason(err: Exception) -> str:
    """Why a file cannot be read; not always in NumPy's words, which tell how to load it with what hides in it."""
    if isinstance(err, KeyError):
        return " ".join(str(err).split())
    return (isinstance(err, OSError) and err.strerror) or "it is damaged, or something else"


@njit(cache=True, nogil=True, fastmath=True, forceinline=True)
def _windows(layer: Float32Array, step: int) -> Float32Array:
    """What each of the weights sees at all places, shape (9 * channels, places)."""
    channels, cells, _ = layer.shape
    sides = cells // step
    padded = np.zeros((cells + 2, cells + 2), np.float32)
    seen = np.empty((9 * channels, sides * sides), np.float32)
    for channel in range(channels):
        for row in range(cells):
            for column in range(cells):
                padded[row + 1, column + 1] = layer[channel, row, column]
        for weight in range(9):
            down, across = weight // 3, weight % 3
            for row in range(sides):
                source, line = padded[row * step + down], seen[9 * channel + weight, row * sides : (row + 1) * sides]
                # A step that is known lets the first be copied as a whole.
                if step == 1:
                    for column in range(sides):
                        line[column] = source[column + across]
                else:
                    for column in range(sides):
                        line[column] = source[column * step + across]
    return seen


@njit(cache=True, nogil=True, fastmath=True)
def convolve(layer: Float32Array, kernels: Float32Array, biases: Float32Array, step: int) -> Float32Array:
    """A convolution of 3 x 3 with a border of 0, and a ReLU.

    Args:
        layer: shape (before, cells, cells); `cells` is a multiple of `step`.
        kernels: shape (after, 9 * before); `after` is a multiple of 4.
        biases: shape (after,).
        step: 1 or 2.

    Returns:
        shape (after, cells / step, cells / step).
    """
    after, sides = kernels.shape[0], layer.shape[1] // step
    seen = _windows(layer, step)
    out = np.empty((after, sides * sides), np.float32)
    # Four sums of three products at a time, so that they are fetched and put back less often.
    for first in range(0, after, 4):
        sums, weights = out[first : first + 4], kernels[first : first + 4]
        for number in range(4):
            sums[number] = biases[first + number]
        for at in range(0, len(seen), 3):
            a, b, c = weights[:, at], weights[:, at + 1], weights[:, at + 2]
            a0, b0, c0, a1, b1, c1 = a[0], b[0], c[0], a[1], b[1], c[1]
            a2, b2, c2, a3, b3, c3 = a[2], b[2], c[2], a[3], b[3], c[3]
            for place in range(sides * sides):
                x, y, z = seen[at, place], seen[at + 1, place], seen[at + 2, place]
                sums[0, place] += a0 * x + b0 * y + c0 * z
                sums[1, place] += a1 * x + b1 * y + c1 * z
                sums[2, place] += a2 * x + b2 * y + c2 * z
                sums[3, place] += a3 * x + b3 * y + c3 * z
        for number in range(4):
            for place in range(sides * sides):
                sums[number, place] = max(sums[number, place], np.float32(0))
    return out.reshape(after, sides, sides)
