"""Whether a camera that was moving stands still now: what lies beside the targets has no events any more, all over the
sensor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set

import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.boxes import Box
from etd_ros.tracking.contour_kernels import Float64Array

SAMPLES = 2048
"""About so many pixels are enough to tell."""
BLOCKS = 4
"""Parts of the sensor, as many across as down."""
LIVELY_MIN, LIVELY_SHARE = 6, 0.25
"""In so many of them at once pixels fire, at a share of the mean rate of all, where the camera moves: one thing that
moves is in fewer."""
RECENT_S, USUAL_S = (0.02, 0.1), 0.5
"""Averages over these times are compared; the recent one over as long as it takes for EVENTS_MIN."""
REST_SHARE, MOVING_SHARE = 0.2, 0.4
"""At rest there are fewer events than this share of the usual ones; from the second on it moves again."""
EVENTS_MIN = 24.0
"""So many are usual in the recent time: that there are none would be chance otherwise."""
HALT_NS = 300_000_000
"""What had no events within so long has lost them by the halt; what has none later has gone behind something."""
BESIDE = 1.5
"""Width and height in those of a box of what its target may fill with events."""


class CameraRest:
    """Follows how many pixels fire beside the targets.

    Attributes:
        is_at_rest: whether the camera has come to a halt.
        sees_motion: whether pixels fire all over the sensor, as before a camera that moves.
        has_just_halted: whether it has done so just now.
    """

    def __init__(self) -> None:
        self._names: Set[str] = set()
        self.forget()

    def forget(self) -> None:
        """The stream starts again."""
        self.is_at_rest = False
        self.sees_motion = False
        self.has_just_halted = False
        self._halted_ns = 0
        self._recent_hz = np.zeros((BLOCKS, BLOCKS))
        self._usual_hz = self._usual_lively = 0.0

    def take(self, stamp_ns: int, data: npt.NDArray[np.uint8], duration_s: float, boxes: Mapping[str, Box]) -> None:
        """Take a frame: its end (ns), its levels, uint8, shape (height, width, 2), how long it lasted (s), and where
        targets are (pixels), by name."""
        if boxes.keys() - self._names:
            # What a new target did so far was taken for what the camera does.
            self.forget()
        self._names = boxes.keys()
        if duration_s <= 0:
            return
        height, width, _ = data.shape
        stride = max(1, math.isqrt(height * width // SAMPLES))
        taken = np.array(list(boxes.values()), np.float64).reshape(-1, 4)
        gain = _gain(duration_s, self._recent_s)
        fired_hz = fired(data, stride, taken, BESIDE, self._recent_hz, gain, duration_s)
        recent_hz, lively = lively_parts(self._recent_hz, LIVELY_SHARE)
        if self.is_at_rest:
            self.is_at_rest = recent_hz < MOVING_SHARE * self._usual_hz
        elif recent_hz < REST_SHARE * self._usual_hz and self._was_moving:
            self.is_at_rest, self._halted_ns = True, stamp_ns
        self.sees_motion = lively >= LIVELY_MIN and not self.is_at_rest
        self.has_just_halted = self.is_at_rest and stamp_ns - self._halted_ns < HALT_NS
        if not self.is_at_rest:
            gain = _gain(duration_s, USUAL_S)
            self._usual_hz += gain * (fired_hz - self._usual_hz)
            self._usual_lively += gain * (lively - self._usual_lively)

    @property
    def _recent_s(self) -> float:
        shortest_s, longest_s = RECENT_S
        return min(max(EVENTS_MIN / max(self._usual_hz, 1e-9), shortest_s), longest_s)

    @property
    def _was_moving(self) -> bool:
        return self._usual_hz * RECENT_S[1] > EVENTS_MIN and self._usual_lively >= LIVELY_MIN


def _gain(duration_s: float, time_constant_s: float) -> float:
    return 1 - math.exp(-duration_s / time_constant_s)


@njit(cache=True, nogil=True)
def fired(
    data: npt.NDArray[np.uint8],
    stride: int,
    boxes: Float64Array,
    times: float,
    rates_hz: Float64Array,
    gain: float,
    duration_s: float,
) -> float:
    """Take into the rates of each part of the sensor how many of the pixels that are `stride` apart have fired in no
    box.

    Args:
        data: the frame, shape (height, width, 2).
        stride: pixels from one to the next, along rows and columns.
        boxes: x, y, width and height (pixels), shape (boxes, 4).
        times: boxes count as if they were so many times as wide and high.
        rates_hz: pixels/s in each part, shape (BLOCKS, BLOCKS); renewed.
        gain: by this share, 0 to 1.
        duration_s: how long the frame lasted (s).

    Returns:
        The frame's own rate, of all parts (pixels/s).
    """
    height, width, _ = data.shape
    total = 0
    rates_hz *= 1 - gain
    margin = (times - 1) / 2
    for row in range(0, height, stride):
        for column in range(0, width, stride):
            if data[row, column, 0] == 0 and data[row, column, 1] == 0:
                continue
            is_inside = False
            for number in range(len(boxes)):
                x, y, box_width, box_height = boxes[number]
                across, down = column - x + margin * box_width, row - y + margin * box_height
                if 0 <= across < times * box_width and 0 <= down < times * box_height:
                    is_inside = True
                    break
            if not is_inside:
                total += 1
                rates_hz[row * BLOCKS // height, column * BLOCKS // width] += gain / duration_s
    return total / duration_s


@njit(cache=True, nogil=True)
def lively_parts(rates_hz: Float64Array, share: float) -> tuple[float, int]:
    """The sum of the rates, and how many exceed this share of their mean."""
    total = rates_hz.sum()
    least, lively = share * total / rates_hz.size, 0
    for rate_hz in rates_hz.flat:
        lively += rate_hz > least
    return total, lively
