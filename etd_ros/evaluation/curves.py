"""Success and precision curves, and speed, from what cells brought.

Success and precision plots are those of Wu, Lim, Yang: Online Object Tracking: A Benchmark (CVPR 2013, Sec. 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

OVERLAP_THRESHOLDS = np.linspace(0.0, 1.0, 101)
CENTRE_THRESHOLDS_PX = np.arange(51.0)
MS_PER_S = 1000.0


@dataclass(frozen=True, slots=True)
class Curve:
    """The share of labels that satisfy a threshold.

    Attributes:
        thresholds: IoU, or pixels; float64, shape (n,).
        shares: 0 to 1, NaN without a label; float64, shape (n,).
    """

    thresholds: npt.NDArray[np.float64]
    shares: npt.NDArray[np.float64]

    @property
    def area(self) -> float:
        """The area under the curve by the trapezoidal rule, as a share of its widest: 0 to 1."""
        widths = np.diff(self.thresholds)
        heights = (self.shares[1:] + self.shares[:-1]) / 2
        return float((widths * heights).sum() / widths.sum())


def success_curve(overlaps: Sequence[float]) -> Curve:
    """Share of labels with an overlap of at least each threshold, 0 to 1. Its area is, up to the thresholds' step, the
    mean overlap, AP."""
    values = np.sort(np.asarray(overlaps, np.float64))
    return _curve(OVERLAP_THRESHOLDS, len(values) - np.searchsorted(values, OVERLAP_THRESHOLDS, "left"), len(values))


def precision_curve(centre_errors_px: Sequence[float]) -> Curve:
    """Share of labels whose centre is at most each threshold away, 0 to 50 px. No box is infinitely far away."""
    values = np.sort(np.asarray(centre_errors_px, np.float64))
    return _curve(CENTRE_THRESHOLDS_PX, np.searchsorted(values, CENTRE_THRESHOLDS_PX, "right"), len(values))


def _curve(thresholds: npt.NDArray[np.float64], counts: npt.NDArray[np.int64], labels: int) -> Curve:
    shares = counts / labels if labels else np.full(len(thresholds), np.nan)
    return Curve(thresholds, np.asarray(shares, np.float64))


@dataclass(frozen=True, slots=True)
class Speed:
    """How fast a system is; all NaN where nothing was measured.

    Attributes:
        frame_ms: its time for an answer (ms).
        frames_per_s: answers in a second of its time.
        events_per_s: events behind these answers in a second of its time.
    """

    frame_ms: float
    frames_per_s: float
    events_per_s: float


def speed(frames: int, events: int, seconds: float) -> Speed:
    """Speed from the answers given, the events that they took, and the time (s) of the system for both."""
    if not frames or not seconds > 0:
        return Speed(float("nan"), float("nan"), float("nan"))
    return Speed(seconds / frames * MS_PER_S, frames / seconds, events / seconds)
