"""How the picture moves near a point: the velocity with which most of the edges there go."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from etd_ros.tracking.discovery_kernels import Float64Array
from etd_ros.tracking.edge_flow_kernels import BELOW, COLUMNS, NORMAL_X, NORMAL_Y, RIGHT, SPEED, flows_of
from etd_ros.tracking.recent_events import RecentEvents

SPAN_S = 0.2
"""Edges of so long are asked: slow ones tell their speed in no less."""
REACHES_PX = (50, 150)
"""They lie so far from the point at most, the second where there are hardly any within the first."""
FLOWS_MIN, FLOWS_MAX = 20, 800
"""Of more event pixels every second, third, ... is asked."""
NEAR_SHARE = 0.3
"""An edge counts the less, the farther it is from the point: a Gaussian, of this part of the reach."""
SPEED_MIN_PX_S, SPEED_MAX_PX_S = 6.0, 1500.0
"""What comes along faster is noise, or light that changes."""
SPEEDS, DIRECTIONS = 32, 32
"""Velocities tried: none, and so many speeds in so many directions."""
STRAY_PX_S, STRAY_SHARE = 5.0, 0.15
"""An edge whose speed is off the velocity's by this, and this share of that, counts a quarter."""
FITS = 5
"""The best of them is fitted to the edges that go with it, so often."""
ALL_ALIKE = 1e-3
"""Edges that all lie alike have no motion along themselves: the best that was tried stays."""
FOLLOWED_PX = 10.0
FOLLOWED_MIN_S = 0.025
"""Events are followed for so many pixels, but no shorter than this."""


def velocity_near(events: RecentEvents, x: float, y: float) -> tuple[float, float] | None:
    """The velocity (pixels/s) with which most edges near a point (pixels) go; None where there are hardly any."""
    for reach_px in REACHES_PX:
        flows = _flows(events, x, y, reach_px)
        if len(flows) >= FLOWS_MIN:
            off_px = np.hypot(flows[:, RIGHT], flows[:, BELOW])
            return velocity_of_most(flows, np.exp(-0.5 * (off_px / (NEAR_SHARE * reach_px)) ** 2), _VELOCITIES)
    return None


def followed_s(velocity: tuple[float, float]) -> float:
    """How long events that move so (pixels/s) are followed (s)."""
    return min(max(FOLLOWED_PX / max(math.hypot(*velocity), 1.0), FOLLOWED_MIN_S), SPAN_S)


def _flows(events: RecentEvents, x: float, y: float, reach_px: int) -> Float64Array:
    """The flows of the edges near a point, their places from it, shape (n, COLUMNS)."""
    column, row = int(x), int(y)
    sides = (
        max(row - reach_px, 0),
        min(row + reach_px, events.height),
        max(column - reach_px, 0),
        min(column + reach_px, events.width),
    )
    flows = np.empty((FLOWS_MAX, COLUMNS))
    oldest_ns = events.stamp_ns - round(SPAN_S * 1e9)
    flows = flows[: flows_of(events.times_of_each, events.stamp_ns, oldest_ns, *sides, x, y, flows)]
    return flows[flows[:, SPEED] < SPEED_MAX_PX_S]


def _velocities() -> Float64Array:
    """The velocities that are tried (pixels/s), shape (n, 2)."""
    speeds = np.geomspace(SPEED_MIN_PX_S, SPEED_MAX_PX_S, SPEEDS)
    angles = np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False, dtype=np.float64)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([np.zeros((1, 2)), (speeds[:, None, None] * ways).reshape(-1, 2)])


_VELOCITIES = _velocities()


@njit(cache=True, nogil=True, fastmath=True)
def velocity_of_most(flows: Float64Array, weights: Float64Array, tried: Float64Array) -> tuple[float, float]:
    """The velocity (pixels/s) with which the flows of the largest weight go: the best of some, fitted to those that go
    with it. An edge tells its speed across itself only.

    Args:
        flows: shape (n, COLUMNS).
        weights: how much each of them counts, shape (n,).
        tried: velocities (pixels/s), shape (m, 2).
    """
    most, x, y = -1.0, 0.0, 0.0
    for number in range(len(tried)):
        going = 0.0
        for i in range(len(flows)):
            speed = flows[i, NORMAL_X] * tried[number, 0] + flows[i, NORMAL_Y] * tried[number, 1]
            stray = (flows[i, SPEED] - speed) / (STRAY_PX_S + STRAY_SHARE * abs(speed))
            going += weights[i] / (1 + stray * stray) ** 2
        if going > most:
            most, x, y = going, tried[number, 0], tried[number, 1]
    for _ in range(FITS):
        xx = xy = yy = x_speed = y_speed = 0.0
        for i in range(len(flows)):
            normal_x, normal_y = flows[i, NORMAL_X], flows[i, NORMAL_Y]
            speed = normal_x * x + normal_y * y
            usual = STRAY_PX_S + STRAY_SHARE * abs(speed)
            stray = (flows[i, SPEED] - speed) / usual
            weight = weights[i] / ((1 + stray * stray) * usual) ** 2
            xx += weight * normal_x * normal_x
            xy += weight * normal_x * normal_y
            yy += weight * normal_y * normal_y
            x_speed += weight * normal_x * flows[i, SPEED]
            y_speed += weight * normal_y * flows[i, SPEED]
        determinant = xx * yy - xy * xy
        if determinant <= ALL_ALIKE * (xx + yy) ** 2:
            break
        x = (yy * x_speed - xy * y_speed) / determinant
        y = (xx * y_speed - xy * x_speed) / determinant
    return x, y
