"""How fast a target turns, by the flow of its edges.

Looks hardly tell at first: some shift always agrees best with edges that go round, and a model that was drawn of them
as they move along is of no thing. Later they tell by little and little, but not when what turns turns back, as all
polarities change then.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.body import Body
from etd_ros.tracking.contour_kernels import AGE, Float32Array, Float64Array
from etd_ros.tracking.edge_flow import EdgeFlow, EdgeFlows
from etd_ros.tracking.growth import FLOW_MARGIN_PX, START_MOVED_PX
from etd_ros.tracking.measured_rate import MeasuredRate
from etd_ros.tracking.surface import TimeSurface

START_ERRORS, START_SPREAD_MAX = 6.0, 0.6
"""What starts turns if that is so many standard errors from 0, has moved its outline by START_MOVED_PX, and leaves no
more than this share of what the speeds of its edges stray by otherwise: what passes at two depths seems to turn, too,
but goes hardly better with that."""
MEASURE_S = 0.01
SPAN_PX, SPAN_MIN_S, SPAN_MAX_S = 5.0, 0.01, 0.1
"""The flow of so much motion is taken, within these times."""
ERRORS, ERROR_FLOOR_RAD_S = 3.0, 0.2
"""The flow is off by so many times its standard error, as neighbours go wrong together, and by so much besides."""
ERROR_MAX_RAD_S = 1.0
"""A flow with a larger standard error is not asked."""
TOO_FAST_SHARE = 0.35
"""Of little motion only the fastest edges come far enough to be seen: a rate that differs by this share of the flow's
is as likely."""
UNKNOWN_RAD_S, CHANGES_RAD_S = 3.0, 4.5
"""How fast a target may turn of which nothing is known, and by how much that wanders within a second."""
KNOWN_MIN, BEGINS_ERRORS = 0.8, 6.0
"""A look that would begin a turn is believed by how much more than the first is known of its direction of motion, or
where the flow turns the same way by so many of its standard errors."""


class Turned(NamedTuple):
    """How a target has moved since its start: its middle's velocity, x and y (pixels/s), turning (rad/s) and growing
    (1/s)."""

    velocity: Float64Array
    turning_rad_s: float
    growing_per_s: float

    @classmethod
    def of_flow(
        cls, flow: EdgeFlow, growing_per_s: float, middle: Float64Array, place: Float64Array, time_s: float
    ) -> Turned:
        """By the flow of its edges round a place (pixels), whose events came so long after (s) the target's middle was
        at `middle`, on average: where that was by then depends on how it moves."""
        turning_rad_s = flow.turning_rad_s
        change = np.array([[growing_per_s, -turning_rad_s], [turning_rad_s, growing_per_s]])
        velocity = np.linalg.solve(np.eye(2) - change * time_s, flow.velocity + change @ (middle - place))
        return cls(np.asarray(velocity, np.float64), turning_rad_s, growing_per_s)

    def undone(self, events: Float32Array, middle: Float64Array) -> Float32Array:
        """Events, whose ages count backwards from the start, where they would have been then; the target's middle was
        at `middle` (pixels). Within a start things turn by more than what a straight line could stand for."""
        moved = events.copy()
        moved[:, :2] = middle + self.from_middle(events, middle)
        return moved

    def from_middle(self, events: Float32Array, middle: Float64Array) -> Float64Array:
        """The same places from the target's middle (pixels), not rounded, float64, shape (n, 2)."""
        age_s = events[:, AGE].astype(np.float64)
        right, down = (events[:, :2] + np.outer(age_s, self.velocity) - middle).T
        cos, sin = np.cos(self.turning_rad_s * age_s), np.sin(self.turning_rad_s * age_s)
        size = np.exp(self.growing_per_s * age_s)
        return np.stack([size * (cos * right - sin * down), size * (sin * right + cos * down)], axis=1)


def turning_at_start(flows: EdgeFlows, arm_px: float, time_s: float) -> float:
    """How fast a target has turned since its start (rad/s) by the flow of its edges; 0 where it may as well not turn.

    Args:
        flows: of its edges.
        arm_px: how far its outline is from its middle (pixels).
        time_s: since its start (s).
    """
    along, turning = flows
    rate = turning.turning_rad_s
    if abs(rate) * arm_px * time_s < START_MOVED_PX or abs(rate) < START_ERRORS * turning.turning_error:
        return 0.0
    return rate if turning.spread_px_s <= START_SPREAD_MAX * along.spread_px_s else 0.0


class TurningByFlow:
    """Puts the rate at which a target turns right while it is followed."""

    def __init__(self) -> None:
        self._rate = MeasuredRate(MEASURE_S, UNKNOWN_RAD_S, CHANGES_RAD_S)

    def correction(
        self, surface: TimeSurface, box: Box, place: tuple[float, float], speed_px_s: float, turning_rad_s: float
    ) -> float:
        """What to add to the rate of turning (rad/s).

        Args:
            surface: the events.
            box: the target's (pixels).
            place: x, y of its middle (pixels).
            speed_px_s: how fast its edges pass over pixels.
            turning_rad_s: how fast it is taken to turn (rad/s).
        """
        if not self._rate.is_due(surface.stamp_ns):
            return 0.0
        span_s = _span_s(speed_px_s)
        flow = _turning_flow(surface, box, place, span_s)
        if flow is None or flow.turning_error > ERROR_MAX_RAD_S:
            return 0.0
        more = flow.turning_rad_s - turning_rad_s
        if flow.turning_rad_s * turning_rad_s > 0:
            more = math.copysign(max(0.0, abs(more) - TOO_FAST_SHARE * abs(flow.turning_rad_s)), more)
        return self._rate.gain(ERRORS * flow.turning_error + ERROR_FLOOR_RAD_S, span_s) * more


class BeginningTurn:
    """How far a look is believed by which a target begins to turn.

    Of a rim only those gradients are known that lie along the motion so far. When the motion turns, the model agrees
    best if it is turned as far as that, though the target is not. The flow of its edges needs no model.
    """

    def __init__(self) -> None:
        self._asked_ns = 0
        self._seen = 0.0

    def trust(
        self, surface: TimeSurface, body: Body, speed_px_s: float, turned: float, known: float, patience: float = 1.0
    ) -> float:
        """0 to 1.

        Args:
            surface: the events.
            body: the target's.
            speed_px_s: how fast its edges pass over pixels.
            turned: what the angle is off by (rad).
            known: how much of what this direction of motion shows has been seen, 0 to 1.
            patience: the flow is asked so many times as seldom.
        """
        by_known = min(max((known - KNOWN_MIN) / (1 - KNOWN_MIN), 0.0), 1.0)
        if by_known == 1:
            return 1.0
        if not 0 <= surface.stamp_ns - self._asked_ns < patience * MEASURE_S * 1e9:
            self._asked_ns = surface.stamp_ns
            self._seen = self._flow_turns(surface, body, speed_px_s)
        return 1.0 if self._seen * turned > 0 else by_known

    def _flow_turns(self, surface: TimeSurface, body: Body, speed_px_s: float) -> float:
        """How fast (rad/s), 0 where the flow may as well not turn."""
        flow = _turning_flow(surface, body.box, body.pose[:2], _span_s(speed_px_s))
        if flow is None or abs(flow.turning_rad_s) < BEGINS_ERRORS * flow.turning_error:
            return 0.0
        return flow.turning_rad_s


def _span_s(speed_px_s: float) -> float:
    """The time of a flow (s) of what passes over pixels so fast."""
    return min(max(SPAN_PX / max(speed_px_s, 1e-3), SPAN_MIN_S), SPAN_MAX_S)


def _turning_flow(surface: TimeSurface, box: Box, place: tuple[float, float], span_s: float) -> EdgeFlow | None:
    """How the edges in a box have turned round a place (pixels) in the last `span_s`."""
    return surface.flow(surface.window(box, FLOW_MARGIN_PX), span_s, *place, may_turn=True)
