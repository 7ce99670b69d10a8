"""Compiles the kernels of the whole method, or loads them from the cache, before the first real event comes."""

from __future__ import annotations

import numpy as np

from etd_ros.boxes import Box
from etd_ros.engine import Engine
from etd_ros.events import Events
from etd_ros.settings import Settings
from etd_ros.stream import StreamGuard

SENSOR_SIDE = 48
SQUARE_SIDE = 16
STEPS = 24
STEP_NS = 2_000_000


def warm_up(settings: Settings | None = None) -> int:
    """Track a small square that moves a few pixels, for a fraction of a second once everything is compiled.

    Returns:
        The number of frames made on the way.
    """
    engine = Engine(SENSOR_SIDE, SENSOR_SIDE, settings=settings)
    engine.tracker.start("square", Box(8, 8, SQUARE_SIDE, SQUARE_SIDE))
    return sum(1 for batch in StreamGuard().feed(_moving_square()) for _ in engine.feed(batch.events))


def _moving_square() -> Events:
    """The outline of a square, a pixel further at each step: Off events in front, On events behind."""
    side = np.arange(SQUARE_SIDE)
    outline_x = np.concatenate([side, side, np.zeros_like(side), np.full_like(side, SQUARE_SIDE - 1)])
    outline_y = np.concatenate([np.zeros_like(side), np.full_like(side, SQUARE_SIDE - 1), side, side])
    step = np.repeat(np.arange(STEPS), len(outline_x))
    x = np.tile(outline_x, STEPS) + 8 + step % 16
    y = np.tile(outline_y, STEPS) + 8
    polarity = (np.tile(outline_x, STEPS) < SQUARE_SIDE // 2).astype(np.uint8)
    t = 1 + step * STEP_NS + np.arange(len(step)) % len(outline_x)
    return Events(t.astype(np.int64), x.astype(np.uint16), y.astype(np.uint16), polarity, SENSOR_SIDE, SENSOR_SIDE)
