"""E-MS: the cluster of events that a target is, followed from packet to packet (Barranco et al. 2018)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.conversion import BackgroundActivityFilter, NoiseFilterConfig
from etd_ros.events import Events, concatenate
from etd_ros.settings import Settings
from etd_ros.systems.interface import Answer, EventTracker
from etd_ros.systems.kalman import Gaussian, corrected, first_estimate, predicted
from etd_ros.systems.mean_shift import mean_shift

PACKET_EVENTS = 1800
REFERENCE_PIXELS = 240 * 180
"""Packets have so many events at so many pixels, and more in proportion."""
NOISE_WINDOW_S = 0.01
AGE_S = 10.0
"""Time constant of the third feature, exp(-age / AGE_S)."""
BANDWIDTH = 0.15
NEAR_PX = math.sqrt(500)
"""A cluster farther from where the target is expected is not the target: at 240x180 pixels, and more in proportion."""
HITS_BEFORE_FILTER = 25
NOT_SAID = float("nan")


@dataclass(frozen=True, slots=True)
class Cluster:
    """A cluster of a packet's events.

    Attributes:
        centre: its mode (pixels).
        box: the smallest box round its events (pixels).
    """

    centre: tuple[float, float]
    box: Box


def clusters(packet: Events) -> list[Cluster]:
    """The clusters of a packet of one or more events, by mean shift over (x / width, y / height, exp(-age / 10 s))."""
    age_s = (packet.t[-1] - packet.t) * 1e-9
    features = np.stack([packet.x / packet.width, packet.y / packet.height, np.exp(-age_s / AGE_S)], axis=1)
    modes, labels = mean_shift(features, BANDWIDTH)
    found = []
    for number, mode in enumerate(modes):
        members = labels == number
        if members.any():
            left, right = (int(bound(packet.x[members])) for bound in (np.min, np.max))
            top, bottom = (int(bound(packet.y[members])) for bound in (np.min, np.max))
            centre = float(mode[0]) * packet.width, float(mode[1]) * packet.height
            found.append(Cluster(centre, Box(float(left), float(top), right - left + 1.0, bottom - top + 1.0)))
    return found


class _Path:
    """Where the target is expected: where it was, or where the filter says once there is one.

    The filter starts with the velocity of the hits before it.
    """

    def __init__(self, centre: tuple[float, float]) -> None:
        self._centre = centre
        self._hits = 0
        self._first: tuple[int, tuple[float, float]]
        self._stamp_ns = 0
        self._estimate: Gaussian | None = None

    def expected(self, stamp_ns: int) -> tuple[float, float]:
        """The centre (pixels) at a time (ns) not before the last hit."""
        return self._centre if self._estimate is None else self._predicted(self._estimate, stamp_ns).position

    def hit(self, stamp_ns: int, centre: tuple[float, float]) -> None:
        """The target's cluster has been found at a centre (pixels)."""
        self._hits += 1
        if self._estimate is not None:
            self._estimate = corrected(self._predicted(self._estimate, stamp_ns), centre)
        elif self._hits == 1:
            self._first = stamp_ns, centre
        elif self._hits == HITS_BEFORE_FILTER:
            first_ns, first = self._first
            passed_s = max(1, stamp_ns - first_ns) * 1e-9
            self._estimate = first_estimate(
                centre, ((centre[0] - first[0]) / passed_s, (centre[1] - first[1]) / passed_s)
            )
        self._stamp_ns, self._centre = stamp_ns, centre

    def _predicted(self, estimate: Gaussian, stamp_ns: int) -> Gaussian:
        return predicted(estimate, (stamp_ns - self._stamp_ns) * 1e-9)


class EventClusterTracker:
    """An `EventTracker` whose target is the cluster nearest to where it was; after 25 packets in which it was found, to
    where a Kalman filter expects it.

    Packets of 1,800 events without noise; the box is the smallest round the cluster's events. Where no cluster is near
    enough, the target is lost in that packet and looked for at the same place (the filter's, once there is one) in the
    next.
    """

    def __init__(self) -> None:
        self._filter: BackgroundActivityFilter | None = None
        self._waiting: list[Events] = []
        self._path: _Path | None = None
        self._start_ns = 0

    def start(self, stamp_ns: int, box: Box) -> None:
        """The target is at `box` (pixels) at this time (ns)."""
        self._start_ns = stamp_ns
        self._path = _Path(box.center)

    def update(self, events: Events) -> Iterator[tuple[int, Answer]]:
        """An answer for each packet that is complete, at the time (ns) of its last event."""
        if self._filter is None:
            noise = NoiseFilterConfig(window_s=NOISE_WINDOW_S)
            self._filter = BackgroundActivityFilter(events.width, events.height, noise)
        for packet in self._packets(self._filter.filter(events)):
            stamp_ns = int(packet.t[-1])
            if self._path is not None and stamp_ns >= self._start_ns:
                yield stamp_ns, _answer(packet, stamp_ns, self._path)

    def _packets(self, events: Events) -> Iterator[Events]:
        """Packets as they fill up; the rest waits for more events."""
        size = max(1, round(PACKET_EVENTS * events.width * events.height / REFERENCE_PIXELS))
        held = concatenate([*self._waiting, events])
        whole = len(held) // size * size
        self._waiting = [held[whole:]]
        for first in range(0, whole, size):
            yield held[first : first + size]


def _answer(packet: Events, stamp_ns: int, path: _Path) -> Answer:
    """The target in a packet, which is noted on its path."""
    near_px = NEAR_PX * math.sqrt(packet.width * packet.height / REFERENCE_PIXELS)
    expected = path.expected(stamp_ns)
    nearest = min(clusters(packet), key=lambda cluster: math.dist(cluster.centre, expected))
    if math.dist(nearest.centre, expected) > near_px:
        return Answer(None, NOT_SAID)
    path.hit(stamp_ns, nearest.centre)
    return Answer(nearest.box, NOT_SAID)


def e_ms_maker(settings: Settings, seed: int) -> Callable[[], EventTracker]:  # noqa: ARG001
    """What makes E-MS trackers, which are not random and have the paper's parameters."""
    return EventClusterTracker
