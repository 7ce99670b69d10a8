"""Non-Zero Grid Entropy (paper section 3.2) and the confidence interval of its values."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.conversion.frame import ConversionError

CELL_SIZE = 4
LOG_BASE = 256.0
"""Normalises a cell's entropy to [0, 1]: then the paper's interval means a contour displacement of about 3 px."""

CELL_SIZE_MAX = 16
GREY_LEVELS = 256

FloatArray = npt.NDArray[np.float64]


def nzge(frame_data: npt.NDArray[np.uint8], cell_size: int = CELL_SIZE, log_base: float = LOG_BASE) -> float:
    """Non-Zero Grid Entropy of a frame (paper section 3.2, equations 3 and 4).

    A cell's entropy is the mean over the two channels of -sum(p_z log p_z), p_z the share of grey level z; the result
    is the mean over the cells whose entropy is not zero, 0.0 if there is none. At the right and bottom border of a
    sensor that cell_size does not divide, cells are filled up with pixels that never have an event.

    Args:
        frame_data: uint8, shape (height, width, 2).
        cell_size: r, the side of a cell (pixels), 2 to 16.
        log_base: base of the logarithm, above 1.

    Raises:
        ConversionError: another dtype or shape, or cell_size or log_base out of range.
    """
    if frame_data.dtype != np.uint8 or frame_data.ndim != 3 or frame_data.shape[2] != 2:
        msg = f"nzge needs uint8 (height, width, 2), not {frame_data.dtype} {frame_data.shape}"
        raise ConversionError(msg)
    check_grid(cell_size, log_base)
    return float(_frame_nzge(frame_data, cell_size, count_log_counts(cell_size), 1 / math.log(log_base)))


def check_grid(cell_size: int, log_base: float) -> None:
    """Refuse cells and bases that NZGE is not defined for.

    Raises:
        ConversionError: cell_size is not in 2 to 16, or log_base is not a finite number above 1.
    """
    if not 2 <= cell_size <= CELL_SIZE_MAX:
        msg = f"cell size {cell_size} is out of range: choose 2 to {CELL_SIZE_MAX} pixels"
        raise ConversionError(msg)
    if not (math.isfinite(log_base) and log_base > 1):
        msg = f"log base {log_base} is out of range: choose a number above 1"
        raise ConversionError(msg)


def count_log_counts(cell_size: int) -> FloatArray:
    """The values c ln c, c = 0 .. cell_size^2: the entropy of a cell of m pixels is ln m - sum(c ln c) / m (nats)."""
    counts = np.arange(cell_size * cell_size + 1, dtype=np.float64)
    return counts * np.log(np.maximum(counts, 1))


def confidence_interval(samples: Sequence[float] | FloatArray, significance: float = 0.05) -> tuple[float, float]:
    """[alpha, beta]: the interval of the mean NZGE of sampled frames with sharp contours (paper equations 5 to 7).

    Args:
        samples: NZGE values of at least two frames.
        significance: probability that the mean lies outside, in (0, 1).

    Raises:
        ConversionError: fewer than two samples, values that are not finite, or significance out of range.
    """
    values = np.asarray(samples, np.float64)
    if values.ndim != 1 or len(values) < 2 or not np.isfinite(values).all():
        msg = f"a confidence interval needs at least two finite samples, not {values.size}: sample more frames"
        raise ConversionError(msg)
    return interval_from_statistics(float(values.mean()), float(values.std(ddof=1)), len(values), significance)


def interval_from_statistics(mean: float, std: float, n: int, significance: float = 0.05) -> tuple[float, float]:
    """[alpha, beta] from the samples' mean, standard deviation (with n - 1) and number (paper equation 7).

    Raises:
        ConversionError: n below 2, std negative or not finite, or significance outside (0, 1).
    """
    if n < 2 or not (math.isfinite(mean) and math.isfinite(std) and std >= 0) or not 0 < significance < 1:
        msg = f"no interval from mean {mean}, std {std}, n {n}, significance {significance}: sample at least two frames"
        raise ConversionError(msg)
    # Nodes never calibrate, and start sooner without.
    from scipy.special import stdtrit

    half_width = float(stdtrit(n - 1, 1 - significance / 2)) * std / math.sqrt(n)
    return mean - half_width, mean + half_width


@njit(cache=True, nogil=True)
def _frame_nzge(data: npt.NDArray[np.uint8], cell_size: int, c_log_c: FloatArray, per_log_base: float) -> float:
    height, width, channels = data.shape
    pixels = cell_size * cell_size
    level_counts = np.zeros(GREY_LEVELS, np.int64)
    total = 0.0
    cells = 0
    for top in range(0, height, cell_size):
        bottom = min(top + cell_size, height)
        for left in range(0, width, cell_size):
            right = min(left + cell_size, width)
            entropy = 0.0
            levels_max = 0
            for channel in range(channels):
                beyond_border = pixels - (bottom - top) * (right - left)
                level_counts[0] = beyond_border
                sum_c_log_c = c_log_c[beyond_border]
                levels = int(beyond_border > 0)
                for y in range(top, bottom):
                    for x in range(left, right):
                        count = level_counts[data[y, x, channel]]
                        level_counts[data[y, x, channel]] = count + 1
                        sum_c_log_c += c_log_c[count + 1] - c_log_c[count]
                        levels += count == 0
                level_counts[0] = 0
                for y in range(top, bottom):
                    for x in range(left, right):
                        level_counts[data[y, x, channel]] = 0
                levels_max = max(levels_max, levels)
                if levels > 1:
                    entropy += np.log(pixels) - sum_c_log_c / pixels
            # Zero is decided by the number of levels: the sums above leave rounding errors.
            if levels_max > 1:
                total += entropy / channels
                cells += 1
    return total / cells * per_log_base if cells else 0.0
