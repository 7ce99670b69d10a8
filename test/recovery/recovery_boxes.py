"""Views of boxes for the tests of the network that puts them right."""

from __future__ import annotations

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking import BoxView
from etd_ros.tracking.box_view import CELLS, FIRST_CELLS

BOX_SEEDS = 28, 39
"""Of scenes that are simulated and followed in less than a second: one target, two targets."""
SENSOR = 240, 180


def view_of(
    box: Box, points: int = 500, target: str = "square", stamp_ns: int = 0, seed: int = 0, span_s: float = 0.02
) -> BoxView:
    """A view in which nothing is alike: events anywhere round the box, known pictures of noise."""
    rng = np.random.default_rng(seed)
    places = np.array(box.center) + rng.uniform(-1.4, 1.4, (points, 2)) * (box.w, box.h)
    ages, polarities = rng.uniform(0, span_s, points), rng.choice([-1.0, 1.0], points)
    return BoxView(
        target=target,
        stamp_ns=stamp_ns,
        points=np.column_stack([places, ages, polarities]).astype(np.float32),
        span_s=span_s,
        box=box,
        velocity=np.array([130.0, -70.0]),
        usual=rng.normal(size=(3, CELLS, CELLS)).astype(np.float32),
        first=rng.normal(size=(3, FIRST_CELLS, FIRST_CELLS)).astype(np.float32),
        sensor=SENSOR,
        age_s=0.3,
        growing_per_s=-0.8,
    )


def put_right(box: Box, misfit: np.ndarray) -> Box:
    """The box, moved and resized by how far it is off."""
    right, below, wider, higher = misfit.tolist()
    x, y = box.center[0] + right * box.w, box.center[1] + below * box.h
    width, height = box.w * np.exp(wider), box.h * np.exp(higher)
    return Box(x - width / 2, y - height / 2, width, height)
