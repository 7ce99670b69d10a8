"""Rows out of subjects: the same rules for every part of the event path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from etd_ros.benchmarking.measure import Subject, compare
from etd_ros.benchmarking.report import Row
from etd_ros.benchmarking.streams import Stream

MEV_PER_S, MS = "Mev/s", "ms"


def rows(
    what: str,
    stream: Stream,
    ours: Subject,
    peers: Sequence[Subject],
    rounds: int,
    *,
    unit: str = MEV_PER_S,
    frames: int = 0,
    events: int = 0,
) -> Iterator[Row]:
    """A row per peer, or one without peer where there is none.

    Args:
        what: the part of the event path.
        stream: what the subjects work on.
        ours: our code; its units are events for Mev/s, calls for ms.
        peers: what to hold it against.
        rounds: pairs of runs.
        unit: Mev/s or ms.
        frames: frames that one run of ours makes.
        events: how many events are in them.
    """
    everyone: Sequence[Subject | None] = peers or [None]
    for peer in everyone:
        times = compare(ours, peer, rounds)
        run_s = float(np.median(times.ours_s)) * ours.units
        yield Row(
            what=what,
            sensor=stream.sensor,
            value=_figure(times.ours_s, unit),
            unit=unit,
            peer=None if peer is None else peer.name,
            peer_value=None if times.peer_s is None else _figure(times.peer_s, unit),
            ratio=times.ratio,
            stream=stream.name,
            spread=times.spread,
            frames_per_s=frames / run_s if frames else None,
            events_per_frame=events / frames if frames else None,
        )


def _figure(seconds_per_unit: npt.NDArray[np.float64], unit: str) -> float:
    seconds = float(np.median(seconds_per_unit))
    return seconds * 1e3 if unit == MS else 1e-6 / seconds
