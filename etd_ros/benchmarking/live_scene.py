"""What the live benchmark's sensor sees: a target on its way round, whose box is known, beside a busy picture.

```
+--------+------------------+
|  still | a texture that   |   The target goes round before the wall. The texture brings as many events as the rate
|  wall, | moves as one,    |   asks for. One event in fifty is noise anywhere.
| target | leaves or water  |
+--------+------------------+
```
"""

from __future__ import annotations

import functools
import math

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.events import Events, concatenate
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, Waypoint, simulate
from etd_ros.simulation.textures import DARK, blobs, smooth_noise

NS_PER_US = 1000
TURN_US = 1_024_000
"""The target's time for one turn: a multiple of evt3's 4096 us and of the messages' 4 ms."""

TARGET = "target"
SENSORS = {(240, 180): (40, 24), (640, 480): (60, 40), (1280, 720): (80, 60)}
"""Size of the target and radius of its way (pixels), by sensor size."""

MARGIN_PX = 10
"""What is left free of texture round the target's way."""

NOISE_SHARE, TEXTURE_SHARE = 0.02, 0.5
PATCH_PX = 16
RIM_PX = 3.5
SEED = 5
IntArray = npt.NDArray[np.int64]


class LiveScene:
    """A picture for a sensor of `SENSORS`.

    Args:
        width, height: the sensor's size (pixels).
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self._size_px, self._radius_px = SENSORS[width, height]
        self._zone_px = self._size_px + 2 * (self._radius_px + MARGIN_PX)
        self._turn = _turn_events(self._size_px, self._radius_px, self._zone_px)
        rng = np.random.default_rng(SEED)
        columns = width - self._zone_px
        self._points = rng.permutation(columns * height)[: round(TEXTURE_SHARE * columns * height)]

    def box(self, time_us: float) -> Box:
        """Where the target is then (us since the start; it comes round every `TURN_US`), in pixels."""
        angle = 2 * math.pi * time_us / TURN_US
        left, top = self._radius_px * math.cos(angle), self._radius_px * math.sin(angle)
        inset = self._zone_px / 2 - self._size_px / 2
        return Box(left + inset, top + inset + self._zone_top, self._size_px, self._size_px)

    def events(self, first_us: int, duration_us: int, count: int, rng: np.random.Generator) -> Events:
        """The events of one message, `count` of them (or those of the target alone, if they are more), in time order.

        Args:
            first_us: since the start of the scene (us); events come from then on.
            duration_us: how long the message lasts (us), below 2^16 and a turn.
            count: how many there shall be.
            rng: of the noise.
        """
        target = self._target(first_us, duration_us)
        noise = rng.binomial(max(0, count - len(target)), NOISE_SHARE)
        texture = max(0, count - len(target) - noise)
        parts = [target, self._noise(duration_us, noise, rng), self._texture(first_us, duration_us, texture)]
        us, x, y, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txyp")
        # 16 bits are sorted by their digits, which takes a tenth of the time.
        order = np.argsort(us.astype(np.uint16), kind="stable")
        return Events((us[order] + first_us) * NS_PER_US, x[order], y[order], p[order], self.width, self.height)

    @property
    def _zone_top(self) -> int:
        return (self.height - self._zone_px) // 2

    def _target(self, first_us: int, duration_us: int) -> Events:
        """Its events; times in us from the message's start."""
        start_us = first_us % TURN_US
        turns = [_between(self._turn, start_us - turn * TURN_US, duration_us) for turn in (0, 1)]
        times = [part.t + turn * TURN_US - start_us for turn, part in enumerate(turns)]
        x, y, p = (np.concatenate([getattr(part, name) for part in turns]) for name in "xyp")
        return self._events(np.concatenate(times), x, y + np.uint16(self._zone_top), p)

    def _noise(self, duration_us: int, count: int, rng: np.random.Generator) -> Events:
        x, y = rng.integers(0, self.width, count, np.uint16), rng.integers(0, self.height, count, np.uint16)
        return self._events(rng.integers(0, duration_us, count), x, y, rng.integers(0, 2, count, np.uint8))

    def _texture(self, first_us: int, duration_us: int, count: int) -> Events:
        """Points right of the target's zone, each of which fires once while the texture moves by a pixel."""
        columns = self.width - self._zone_px
        # Messages hold about equally many events, so those of all messages before number the points.
        number = first_us // duration_us * count + np.arange(count)
        step, index = np.divmod(number, len(self._points))
        row, column = np.divmod(self._points[index], columns)
        polarity = ((column // PATCH_PX + row // PATCH_PX) % 2).astype(np.uint8)
        x = self._zone_px + (column + step) % columns
        return self._events(np.arange(count) * duration_us // max(1, count), x, row, polarity)

    def _events(
        self, us: IntArray, x: npt.NDArray[np.integer], y: npt.NDArray[np.integer], p: npt.NDArray[np.uint8]
    ) -> Events:
        return Events(us, x.astype(np.uint16), y.astype(np.uint16), p, self.width, self.height)


def _between(events: Events, first_us: int, duration_us: int) -> Events:
    first, end = np.searchsorted(events.t, (first_us, first_us + duration_us))
    return events[int(first) : int(end)]


@functools.lru_cache
def _turn_events(size_px: int, radius_px: int, zone_px: int) -> Events:
    """The target's events over one turn in a picture of zone_px x zone_px pixels; times in us.

    The second turn's are taken: they end as they begin.
    """
    rng = np.random.default_rng(SEED)
    wall = 0.45 + 0.25 * smooth_noise(rng, zone_px, zone_px)
    angles = 2 * math.pi * np.arange(0, 2.02, 0.01)
    middle = zone_px / 2
    path = Path(
        [
            Waypoint(
                angle / (2 * math.pi) * TURN_US * 1e-6,
                middle + radius_px * math.cos(angle),
                middle + radius_px * math.sin(angle),
            )
            for angle in angles.tolist()
        ]
    )
    inside, whole = _disc(size_px, RIM_PX), _disc(size_px, 0.0)
    texture = inside * blobs(rng, size_px, size_px) + (1 - inside) * DARK
    scene = Scene(zone_px, zone_px, 2 * TURN_US * 1e-6, wall, (Sprite(TARGET, texture, whole, path),))
    events = concatenate(list(simulate(scene, seed=SEED, config=SensorConfig(noise_rate_hz=0.0))))
    us = Events(events.t // NS_PER_US - TURN_US, events.x, events.y, events.p, zone_px, zone_px)
    return _between(us, 0, TURN_US)


def _disc(size_px: int, inset_px: float) -> npt.NDArray[np.float64]:
    """1 in the disc that a square holds, less an inset, 0 outside, blended over one pixel."""
    y, x = np.mgrid[0:size_px, 0:size_px] - (size_px - 1) / 2
    return np.asarray(np.clip(size_px / 2 - inset_px - np.hypot(x, y) + 0.5, 0, 1), np.float64)
