"""Streams of events to measure on: seeded synthetic ones of several textures, and real recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from etd_ros.errors import EtdError
from etd_ros.events import Events, concatenate
from etd_ros.recordings import open_recording

NS_PER_S = 1_000_000_000
START_NS = 1_700_000_000 * NS_PER_S
MESSAGE_DURATION_NS = 10_000_000
MESSAGE_EVENTS_MAX = 100_000

CONTOUR_SHARE, TEXTURE_SHARE, NOISE_SHARE = 0.04, 0.5, 0.2
PATCH_SIZE = 16

RECORDINGS = {
    "slider_depth": "slider_depth/slider_depth.bag",
    "traffic": "traffic/traffic.mcap",
    "driver evt3": "drivers/evt3_640x480",
    "driver libcaer_cmp": "drivers/libcaer_cmp_346x260",
}
"""Real recordings by the stream's name: paths in the folder of recordings."""

IntArray = npt.NDArray[np.int64]


class BenchmarkError(EtdError):
    """A benchmark that cannot be run or written."""


@dataclass(frozen=True)
class Stream:
    """Events to measure on.

    Attributes:
        name: for the rows.
        events: one or more, in time order.
        kind: the recording's name in `RECORDINGS`, or the pattern's in `SYNTHETIC`.
    """

    name: str
    events: Events
    kind: str = ""

    @property
    def sensor(self) -> str:
        """The sensor's size as WIDTHxHEIGHT."""
        return f"{self.events.width}x{self.events.height}"

    @property
    def rate(self) -> float:
        """Events per second of the stream's own time."""
        return len(self.events) * NS_PER_S / max(1, int(self.events.t[-1] - self.events.t[0]))

    def messages(self, events_max: int = MESSAGE_EVENTS_MAX) -> list[Events]:
        """The events in batches as drivers send them: 10 ms each, at most `events_max` events."""
        return list(_cut(self.events, events_max))


@dataclass(frozen=True)
class Pattern:
    """Points that move over the sensor, one pixel a step; each fires once a step, in an order that stays the same.

    Attributes:
        x, y: the points at the start (pixels), int64, shape (n,).
        direction: angle in which each moves (rad), shape (n,).
        polarity: what each fires, uint8, shape (n,).
    """

    x: IntArray
    y: IntArray
    direction: npt.NDArray[np.float64]
    polarity: npt.NDArray[np.uint8]

    def events(self, width: int, height: int, count: int, rate: float) -> Events:
        """The first `count` events at `rate` events per second; what leaves the sensor enters on the other side."""
        number = np.arange(count)
        step, point = np.divmod(number, len(self.x))
        column = self.x[point] + np.rint(np.cos(self.direction)[point] * step).astype(np.int64)
        row = self.y[point] + np.rint(np.sin(self.direction)[point] * step).astype(np.int64)
        x, y = (column % width).astype(np.uint16), (row % height).astype(np.uint16)
        return Events(_times(number, rate), x, y, self.polarity[point], width, height)


def contours(width: int, height: int, count: int, rate: float, seed: int) -> Events:
    """Outlines of ellipses, 4 % of the pixels, each ellipse moving its own way: On ahead, Off behind."""
    rng = np.random.default_rng(seed)
    wanted = max(1, round(CONTOUR_SHARE * width * height))
    outlines: list[Pattern] = []
    while sum(len(outline.x) for outline in outlines) < wanted:
        outlines.append(_outline(width, height, rng))
    order = rng.permutation(sum(len(outline.x) for outline in outlines))[:wanted]
    parts = ([getattr(outline, name) for outline in outlines] for name in ("x", "y", "direction", "polarity"))
    x, y, direction, polarity = (np.concatenate(part)[order] for part in parts)
    return Pattern(x, y, direction, polarity).events(width, height, count, rate)


def texture(width: int, height: int, count: int, rate: float, seed: int, share: float = TEXTURE_SHARE) -> Events:
    """A carpet of points, half of the pixels (or `share` of them), moving as one.

    Polarity changes from one patch of 16x16 pixels to the next.
    """
    rng = np.random.default_rng(seed)
    points = rng.permutation(width * height)[: max(1, round(share * width * height))]
    y, x = np.divmod(points, width)
    direction = np.full(len(points), rng.uniform(0, 2 * math.pi))
    polarity = ((x // PATCH_SIZE + y // PATCH_SIZE) % 2).astype(np.uint8)
    return Pattern(x, y, direction, polarity).events(width, height, count, rate)


def flicker(width: int, height: int, count: int, rate: float, seed: int) -> Events:  # noqa: ARG001
    """A light that goes on and off: all pixels, read out row by row. Encodings with masks are at their densest."""
    number = np.arange(count)
    cycle, pixel = np.divmod(number, width * height)
    y, x = np.divmod(pixel, width)
    is_on = (cycle % 2 == 0).astype(np.uint8)
    return Events(_times(number, rate), x.astype(np.uint16), y.astype(np.uint16), is_on, width, height)


def uniform(width: int, height: int, count: int, rate: float, seed: int) -> Events:
    """Events anywhere, independent of each other: the worst case for caches."""
    rng = np.random.default_rng(seed)
    x, y = rng.integers(0, width, count, np.uint16), rng.integers(0, height, count, np.uint16)
    return Events(_times(np.arange(count), rate), x, y, rng.integers(0, 2, count, np.uint8), width, height)


def noisy_contours(width: int, height: int, count: int, rate: float, seed: int) -> Events:
    """Contours of which one event in five is replaced by noise anywhere."""
    clean = contours(width, height, count, rate, seed)
    noise = uniform(width, height, count, rate, seed + 1)
    is_noise = np.random.default_rng(seed + 2).random(count) < NOISE_SHARE
    x, y, p = (np.where(is_noise, getattr(noise, name), getattr(clean, name)) for name in ("x", "y", "p"))
    return replace(clean, x=x, y=y, p=p)


SYNTHETIC: dict[str, Callable[[int, int, int, float, int], Events]] = {
    "contours": contours,
    "texture": texture,
    "flicker": flicker,
    "uniform": uniform,
    "noisy contours": noisy_contours,
}


def synthetic(kind: str, width: int, height: int, count: int, rate: float, seed: int = 1) -> Stream:
    """A seeded stream of `count` events of a kind of `SYNTHETIC`, at `rate` events per second."""
    return Stream(f"{kind} {rate / 1e6:g} Mev/s", SYNTHETIC[kind](width, height, count, rate, seed), kind)


def recorded(name: str, folder: Path, count: int) -> Stream | None:
    """A recording of `RECORDINGS`, repeated or cut to about `count` events; None where the folder lacks it.

    Raises:
        RecordingError: the recording is damaged.
        BenchmarkError: it holds no events.
    """
    path = folder / RECORDINGS[name]
    if not path.exists():
        return None
    batches: list[Events] = []
    with open_recording(path) as recording:
        for batch in recording.streams():
            if batch.restart is not None and batches:
                break
            batches.append(batch.events)
            if sum(len(events) for events in batches) >= count:
                break
    if not sum(len(events) for events in batches):
        msg = f"{path}: holds no events to measure on: name another folder with --data"
        raise BenchmarkError(msg)
    return Stream(name, _repeated(concatenate(batches), count), name)


def _repeated(events: Events, count: int) -> Events:
    """The events again and again, each time later, until there are at least `count`."""
    period_ns = int(events.t[-1] - events.t[0]) + 1000
    times = -(-count // len(events))
    return concatenate([replace(events, t=events.t + repeat * period_ns) for repeat in range(times)])


def _cut(events: Events, events_max: int) -> Iterator[Events]:
    start = 0
    while start < len(events):
        end_ns = int(events.t[start]) + MESSAGE_DURATION_NS
        stop = max(start + 1, int(np.searchsorted(events.t, end_ns)))
        yield events[start : min(stop, start + events_max)]
        start = min(stop, start + events_max)


def _outline(width: int, height: int, rng: np.random.Generator) -> Pattern:
    """An ellipse of 5 pixels to a quarter of the sensor, in steps of about a pixel."""
    shortest = min(width, height)
    radius_x, radius_y = rng.uniform(min(5, shortest / 4), max(6, shortest / 4), 2)
    angle = np.linspace(0, 2 * math.pi, max(8, round(math.pi * (radius_x + radius_y))), endpoint=False)
    x = np.rint(rng.uniform(0, width) + radius_x * np.cos(angle)).astype(np.int64)
    y = np.rint(rng.uniform(0, height) + radius_y * np.sin(angle)).astype(np.int64)
    direction = rng.uniform(0, 2 * math.pi)
    ahead = np.cos(angle) * math.cos(direction) / radius_x + np.sin(angle) * math.sin(direction) / radius_y > 0
    return Pattern(x, y, np.full(len(x), direction), ahead.astype(np.uint8))


def _times(number: IntArray, rate: float) -> IntArray:
    return START_NS + (number * (NS_PER_S / rate)).astype(np.int64)
