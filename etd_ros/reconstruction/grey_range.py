"""The range of intensities that an image spreads over its grey levels."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

SAMPLES_MAX = 1 << 16
COARSE_SHIFT = np.uint32(18)
COARSE_BINS = 1 << 13
"""Values of 31 bits (positive float32) are counted by their upper 13: exponent and 5 bits of the mantissa."""
FINE_BITS = 9
FINE_BINS = 1 << FINE_BITS
"""The 18 bits left are found 9 at a time."""
BANKS = 4


class GreyRange:
    """Bounds that leave out the extreme pixels, are some distance apart, and follow the scene slowly.

    Sensors above 65536 pixels are sampled on a grid.
    """

    def __init__(
        self, width: int, height: int, *, dropped_percent: float, range_min: float, range_time_s: float
    ) -> None:
        """A range for images of width x height pixels.

        Args:
            width: image width (pixels).
            height: image height (pixels).
            dropped_percent: pixels left out at either end (%).
            range_min: smallest distance of the bounds.
            range_time_s: time constant with which they follow the scene (s); 0 is at once.
        """
        self._range_min = range_min
        self._range_time_s = range_time_s
        self._step = max(1, math.ceil(math.sqrt(width * height / SAMPLES_MAX)))
        self._sample = np.empty((-(-height // self._step), -(-width // self._step)), np.float32)
        self._first = int(self._sample.size * dropped_percent / 100)
        self._counts = np.empty((BANKS, COARSE_BINS), np.uint32)
        self._candidates = np.empty((2, self._sample.size), np.uint32)
        self.reset()

    def reset(self) -> None:
        """Forget the bounds so far."""
        self._bounds: tuple[float, float] | None = None
        self._stamp_ns = 0

    def follow(self, brightness: npt.NDArray[np.float32], stamp_ns: int) -> tuple[float, float]:
        """The bounds of an image's values at a time (ns), after those at the times before.

        Args:
            brightness: float32, shape (height, width), finite and not negative.
            stamp_ns: the image's time (ns).
        """
        low, high = (float(bound) for bound in self._robust_extremes(brightness))
        missing = max(0.0, self._range_min - (high - low))
        bounds = low - missing / 2, high + missing / 2
        if self._bounds is not None and self._range_time_s > 0:
            kept = math.exp(-max(0, stamp_ns - self._stamp_ns) * 1e-9 / self._range_time_s)
            low, high = (kept * old + (1 - kept) * new for old, new in zip(self._bounds, bounds, strict=True))
            bounds = low, high
        self._bounds, self._stamp_ns = bounds, stamp_ns
        return bounds

    def _robust_extremes(self, brightness: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """The smallest and the largest value once the extreme ones are left out, shape (2,)."""
        np.copyto(self._sample, brightness[:: self._step, :: self._step])
        # The bits of floats that are not negative are in the floats' order.
        bits = self._sample.view(np.uint32).ravel()
        found = _order_statistics(bits, self._first, len(bits) - 1 - self._first, self._counts, self._candidates)
        return np.array(found, np.uint32).view(np.float32)


@njit(cache=True, nogil=True)
def _order_statistics(
    bits: npt.NDArray[np.uint32],
    first: int,
    last: int,
    counts: npt.NDArray[np.uint32],
    candidates: npt.NDArray[np.uint32],
) -> tuple[int, int]:
    """The values of rank `first` and `last` (from 0, first <= last) among numbers below 2^31, shape (n,).

    Radix selection: unlike partitioning, it costs the same for even areas and for noise.
    """
    _count_coarse(bits, counts)
    low_bin, low_rank = _bin_of_rank(counts[0], first)
    high_bin, high_rank = _bin_of_rank(counts[0], last)
    # One comparison tells most values, those between both bins: below `start` the difference wraps round.
    start = np.uint64(low_bin + 1) << np.uint64(COARSE_SHIFT)
    between = np.uint64(max(0, high_bin - low_bin - 1)) << np.uint64(COARSE_SHIFT)
    low_count = high_count = 0
    for value in bits:
        if np.uint64(value) - start >= between:
            coarse = value >> COARSE_SHIFT
            if coarse == low_bin:
                candidates[0, low_count] = value
                low_count += 1
            if coarse == high_bin:
                candidates[1, high_count] = value
                high_count += 1
    low = _select_fine(candidates[0, :low_count], low_rank, counts[0])
    return low, _select_fine(candidates[1, :high_count], high_rank, counts[0])


@njit(cache=True, nogil=True)
def _count_coarse(bits: npt.NDArray[np.uint32], counts: npt.NDArray[np.uint32]) -> None:
    """Count the values by their upper bits into counts[0], shape (4, bins).

    Neighbours are alike: counting four quarters of the image in turn keeps increments from waiting for each other.
    """
    counts[:] = 0
    quarter = len(bits) // BANKS
    for i in range(quarter):
        for bank in range(BANKS):
            counts[bank, bits[bank * quarter + i] >> COARSE_SHIFT] += 1
    for i in range(BANKS * quarter, len(bits)):
        counts[0, bits[i] >> COARSE_SHIFT] += 1
    for bank in range(1, BANKS):
        for coarse in range(COARSE_BINS):
            counts[0, coarse] += counts[bank, coarse]


@njit(cache=True, nogil=True)
def _bin_of_rank(counts: npt.NDArray[np.uint32], rank: int) -> tuple[int, int]:
    """The bin that holds the value of a rank, and the value's rank in it."""
    found = 0
    while counts[found] <= rank:
        rank -= counts[found]
        found += 1
    return found, rank


@njit(cache=True, nogil=True)
def _select_fine(values: npt.NDArray[np.uint32], rank: int, counts: npt.NDArray[np.uint32]) -> int:
    """The value of a rank among values with equal upper bits, which are overwritten."""
    for shift in (np.uint32(FINE_BITS), np.uint32(0)):
        counts[:FINE_BINS] = 0
        for value in values:
            counts[(value >> shift) % FINE_BINS] += 1
        fine, rank = _bin_of_rank(counts, rank)
        count = 0
        for value in values:
            values[count] = value
            count += (value >> shift) % FINE_BINS == fine
        values = values[:count]
    return values[0]  # type: ignore[no-any-return]
