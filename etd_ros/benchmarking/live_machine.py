"""How much of the machine others use while we measure."""

from __future__ import annotations

import os
import resource
import time
from pathlib import Path


class MachineTime:
    """What of the machine's time goes to others from now on: they make latencies worse than they would be."""

    def __init__(self) -> None:
        self._busy_s, self._own_s, self._started_s = _busy_s(), _own_s(), time.monotonic()

    def others_share(self) -> float:
        """Their share of the time of all cores; of our own processes, those that have ended are known."""
        others_s = (_busy_s() - self._busy_s) - (_own_s() - self._own_s)
        cores = os.cpu_count() or 1
        return max(0.0, others_s / cores / (time.monotonic() - self._started_s))


def _busy_s() -> float:
    """Time that the cores have worked for anybody (s)."""
    user, nice, system, _idle, _waiting, irq, soft_irq, steal = map(int, _cpu_line()[1:9])
    return (user + nice + system + irq + soft_irq + steal) / os.sysconf("SC_CLK_TCK")


def _cpu_line() -> list[str]:
    return Path("/proc/stat").read_text().splitlines()[0].split()


def _own_s() -> float:
    """Time that they have worked for this process and its children that have ended (s)."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    )
