"""What a picture shows of the frames before it: where targets came from, and that one was found again."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from etd_ros.tracking import TargetReport, TargetState

TRAIL_S = 0.4
FLASH_S = 0.2
TRAIL_POINTS_MAX = 500
MISSED = (TargetState.RECOVERING, TargetState.LOST)


class _Past:
    """One target's."""

    def __init__(self) -> None:
        self.centers: deque[tuple[int, float, float]] = deque(maxlen=TRAIL_POINTS_MAX)
        self.state: TargetState = TargetState.IDLE
        self.found_ns: int | None = None

    def take(self, stamp_ns: int, report: TargetReport) -> None:
        if report.state is TargetState.TRACKING and self.state in MISSED:
            self.found_ns = stamp_ns
            self.centers.clear()
        self.state = report.state
        if report.box is not None:
            self.centers.append((stamp_ns, *report.box.center))
        while self.centers and self.centers[0][0] < stamp_ns - TRAIL_S * 1e9:
            self.centers.popleft()


class History:
    """Takes every frame's reports, also of frames that are not drawn."""

    def __init__(self) -> None:
        self._stamp_ns = 0
        self._pasts: dict[str, _Past] = {}

    def take(self, stamp_ns: int, reports: Iterable[TargetReport]) -> None:
        """Note where the targets are at `stamp_ns` (ns); those without a report, and all when time goes back, are
        forgotten."""
        reports = tuple(reports)
        known = self._pasts if stamp_ns >= self._stamp_ns else {}
        self._pasts = {report.name: known.get(report.name) or _Past() for report in reports}
        self._stamp_ns = stamp_ns
        for report in reports:
            self._pasts[report.name].take(stamp_ns, report)

    def trail(self, name: str) -> npt.NDArray[np.float64]:
        """Centres of a target's boxes in the last 0.4 s, oldest first: x, y (pixels) and freshness (0 to 1) as
        float64, shape (n, 3)."""
        past = self._pasts.get(name)
        if past is None or not past.centers:
            return np.empty((0, 3))
        return np.array([(x, y, 1 - self._age_s(stamp_ns) / TRAIL_S) for stamp_ns, x, y in past.centers], np.float64)

    def flash(self, name: str) -> float:
        """1 on the frame on which a target was found again, falling to 0 in 0.2 s; 0 otherwise."""
        past = self._pasts.get(name)
        if past is None or past.found_ns is None or past.state is not TargetState.TRACKING:
            return 0.0
        return max(0.0, 1 - self._age_s(past.found_ns) / FLASH_S)

    def _age_s(self, stamp_ns: int) -> float:
        return (self._stamp_ns - stamp_ns) * 1e-9
