"""The motions with which the events of a target's start agree with one another best."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from etd_ros.tracking.cell_weights import WEIGHT_FADES, oval
from etd_ros.tracking.contour_drawing import agreements, climbed, coherence, most_coherent, room_for_parts
from etd_ros.tracking.contour_kernels import Float32Array, Float64Array
from etd_ros.tracking.contours import BORDER_CELLS
from etd_ros.tracking.growth import arm_px
from etd_ros.tracking.start_events import shares_of_pixels, some_of
from etd_ros.tracking.turning import Turned

STEPS_PX = ((0.5, 2), (0.25, 1))
"""(distance of the candidates (pixels at the end of the motion), how many of them to each side), coarse to fine."""
ALONG_STEPS_PX = ((1.0, 4), (0.5, 2), (0.25, 1))
"""The same of those in a direction that is known."""
FAST_STEP_PX, FAST_STEPS = 2.0, 4
"""Motions farther off are tried up to so many of these steps away (pixels at the end of the motion)."""
CHANGE_WEIGHT = 0.001
"""How much coherence a pixel of change (squared) has to bring."""
REST_WEIGHT = 0.1
"""How much coherence a pixel of motion since the start has to bring, over the root of the number of events: of few,
some motion always agrees better than the right one."""
PARTS = 4
"""The time so far is taken in so many parts, whose events have to agree."""
CELL = 1.5
"""Cells of the grid in those of the model: coarser ones are faster, and find the same motion."""
GRID_MARGIN = 1.5
"""Width and height of the grid in those of the box: it holds a ring of what lies round the target."""
RING_FITS = 2
APART_ROUNDS = 3
BEHIND_WEIGHT = 0.7
"""How much less an event counts that moves like the ring."""
AGREED_FLOOR = 0.1
RING_ALIKE_MIN = 0.8
"""The parts of the ring are at least so much alike where it moves as one."""
LEFT_OVER = 0.3
"""An event that agrees with the ring so many times as well as one does on average counts half."""
OWN_STEP_PX, OWN_STEPS = 2.0, 6
"""What moves otherwise than the ring is looked for up to so many of these steps away from its motion (pixels at the end
of the motion)."""
OWN_ALIKE_MIN = 0.45
APART_PX = 2.5
"""Two motions that differ by less are one (pixels at the end of the motion)."""
EVENTS_MIN = 20


class Motion(NamedTuple):
    """A velocity (pixels/s) and what speaks for it: how well the events agree at it, less what chance would bring, and
    how alike their parts are (`coherence`)."""

    velocity: Float64Array
    agreement: float
    alike: float

    def is_clearly_better(self, near: Motion, trust: tuple[tuple[float, float], ...]) -> bool:
        """Whether it is to be believed rather than the best one near by: of few events something always agrees. Where
        those at the near one agree by nothing, that its own parts are alike is enough.

        Args:
            near: the best one near by.
            trust: (how alike its parts have to be, how many times as well as at the near one its events have to agree):
                one of these is enough.
        """
        return any(self.alike >= alike and self.agreement > times * near.agreement for alike, times in trust)


class Apart(NamedTuple):
    """A target that was told from what moves as one round it: its velocity (pixels/s), and the events that are its own,
    shape (n, 4)."""

    velocity: Float64Array
    events: Float32Array


class CoherentMotions:
    """Draws a start's events on a grid round its box, moved back by a motion, and tells how well they agree.

    Events are points whose ages count backwards from the start, shape (n, 4); times are those since the start, or a
    little more (s).

    Args:
        pose: of the target at the start, as that of `Body`.
        size_px: width and height of its box (pixels).
        cell_px: pixels of a model's cell.
    """

    def __init__(self, pose: Float64Array, size_px: tuple[float, float], cell_px: float) -> None:
        self._pose = pose
        self._arm_px = arm_px(*size_px)
        self._cell_px = CELL * cell_px
        width, height = (side / self._cell_px for side in size_px)
        columns, rows = (math.ceil(side * GRID_MARGIN) + BORDER_CELLS for side in (width, height))
        self._weight = oval(rows, columns, width, height, WEIGHT_FADES)
        self._ring = np.asarray(1 - self._weight, np.float32)
        self._room = room_for_parts(PARTS, rows, columns)

    def near(self, events: Float32Array, time_s: float, so_far: Float64Array) -> Motion:
        """The motion of the greatest coherence near a velocity (pixels/s)."""
        return self._near(events, time_s, _alike(events), self._weight, so_far)

    def farther_off(self, events: Float32Array, time_s: float, so_far: Float64Array, near: Motion) -> Motion:
        """The motion of the greatest coherence within FAST_STEPS steps of a velocity (pixels/s), or the best near that
        if none of them agrees better than it."""
        best = self.best_of(some_of(events), time_s, _round(so_far, FAST_STEP_PX / time_s, FAST_STEPS)).velocity
        return near if np.array_equal(best, so_far) else self.near(events, time_s, best)

    def best_of(self, events: Float32Array, time_s: float, velocities: Float64Array) -> Motion:
        """The motion at which the events agree best, of those with these velocities (pixels/s), shape (motions, 2)."""
        return self._best_of(events, time_s, _alike(events), velocities)

    def along(self, events: Float32Array, time_s: float, so_far: Float64Array, direction: Float64Array) -> Motion:
        """The motion at which the events agree best in a direction (of length 1), near a velocity (pixels/s)."""
        events = some_of(events)
        best = self.best_of(events, time_s, (so_far @ direction * direction)[None])
        for step_px, reach in ALONG_STEPS_PX:
            speeds = best.velocity @ direction + np.arange(-reach, reach + 1) * step_px / time_s
            best = self.best_of(events, time_s, speeds[:, None] * direction)
        return best

    def agreement_if(self, turned: Turned, events: Float32Array, time_s: float) -> float:
        """How well the events agree if the target has moved, turned and grown so."""
        undone = turned.undone(events, self._pose[:2])
        agreement, _ = coherence(
            undone, len(undone), _alike(events), self._weight, self._pose, self._cell_px, np.zeros(2), time_s,
            self._room,
        )  # fmt: skip
        around_px_s, outward_px_s = turned.turning_rad_s * self._arm_px, turned.growing_per_s * self._arm_px
        speed_px_s = math.hypot(*turned.velocity, around_px_s, outward_px_s)
        return agreement * _not_by_chance(len(events), speed_px_s, time_s)

    def told_apart(self, events: Float32Array, time_s: float, velocity: Float64Array) -> Float64Array:
        """The target's velocity (pixels/s) near one, by events that count by how much better they agree at it than at
        that of the ring round the target."""
        events = some_of(events)
        of_pixel = shares_of_pixels(events)
        ring = velocity
        for _ in range(RING_FITS):
            ring = self._near(events, time_s, of_pixel, self._ring, ring).velocity
        behind = self._agreements(events, time_s, ring)
        for _ in range(APART_ROUNDS):
            own = self._agreements(events, time_s, velocity) + AGREED_FLOOR
            shares = np.asarray(of_pixel * own / (own + BEHIND_WEIGHT * behind), np.float32)
            velocity = self._near(events, time_s, shares, self._weight, velocity).velocity
        return velocity

    def apart_from(
        self, behind: Float64Array, events: Float32Array, time_s: float, velocity: Float64Array
    ) -> Apart | None:
        """The target told from what moves as one round it, if that moves otherwise.

        What lies behind a target may make most of the events in its box, which agree best at the velocity of that, or
        between both. What is left when the events that agree with the ring are taken away agrees at the target's own.

        Args:
            behind: about how what is round it moves (pixels/s).
            events: of the start.
            time_s: since the start (s).
            velocity: of the target as believed so far (pixels/s).
        """
        some = some_of(events)
        of_pixel = shares_of_pixels(some)
        ring = self._near(some, time_s, of_pixel, self._ring, behind)
        if ring.alike < RING_ALIKE_MIN:
            return None
        own = self._left_over(some, time_s, of_pixel, ring.velocity, velocity)
        if own is None:
            if math.dist(ring.velocity, velocity) * time_s < APART_PX:
                return None
            own = self.told_apart(events, time_s, velocity)
        is_own = self._agreements(events, time_s, own) > self._agreements(events, time_s, ring.velocity)
        kept = np.ascontiguousarray(events[is_own])
        if len(kept) < EVENTS_MIN:
            return Apart(own, events)
        return Apart(self.near(kept, time_s, own).velocity, kept)

    def _left_over(
        self, events: Float32Array, time_s: float, shares: Float32Array, ring: Float64Array, believed: Float64Array
    ) -> Float64Array | None:
        """The velocity at which what does not agree with that of the ring agrees best, if it is neither the one
        believed so far nor worse."""
        behind = self._agreements(events, time_s, ring)
        half = LEFT_OVER * float(behind.mean())
        shares = np.asarray(shares * half / (half + behind), np.float32)
        coarse = self._best_of(events, time_s, shares, _round(ring, OWN_STEP_PX / time_s, OWN_STEPS))
        if math.dist(coarse.velocity, ring) * time_s > (OWN_STEPS - 1) * OWN_STEP_PX:
            # The best at the border of what was tried is none: it goes on to rise beyond.
            return None
        own = self._near(events, time_s, shares, self._weight, coarse.velocity)
        known = self._near(events, time_s, shares, self._weight, believed)
        is_other = math.dist(own.velocity, believed) * time_s >= APART_PX
        is_better = own.agreement >= known.agreement and own.alike >= max(OWN_ALIKE_MIN, known.alike - 0.01)
        return own.velocity if is_other and is_better else None

    def _best_of(self, events: Float32Array, time_s: float, shares: Float32Array, velocities: Float64Array) -> Motion:
        """`best_of` of events that count by shares."""
        number, agreement, alike = most_coherent(
            events, shares, self._weight, self._pose, self._cell_px, velocities, time_s, _rest_weight(len(events)),
            self._room,
        )  # fmt: skip
        return Motion(velocities[number], agreement, alike)

    def _near(
        self, events: Float32Array, time_s: float, shares: Float32Array, weight: Float32Array, so_far: Float64Array
    ) -> Motion:
        """`near` of events that count by shares, in cells that count by weights, coarse to fine."""
        velocity, agreement, alike = so_far, 0.0, 0.0
        rest_weight = _rest_weight(len(events))
        for step_px, reach in STEPS_PX:
            right_px_s, down_px_s, agreement, alike = climbed(
                events, shares, weight, self._pose, self._cell_px, so_far, velocity, step_px, reach, time_s,
                CHANGE_WEIGHT, rest_weight, self._room,
            )  # fmt: skip
            velocity = np.array([right_px_s, down_px_s])
        return Motion(velocity, agreement, alike)

    def _agreements(self, events: Float32Array, time_s: float, velocity: Float64Array) -> Float32Array:
        """How well each of the events agrees with the others, shape (n,)."""
        agreed = np.empty(len(events), np.float32)
        columns = self._weight.shape[1]
        agreements(events, len(events), self._pose, self._cell_px, velocity, time_s, columns, self._room, agreed)
        return agreed


def _round(velocity: Float64Array, step_px_s: float, steps: int) -> Float64Array:
    """Velocities (pixels/s) up to so many steps from one, which is among them, shape (velocities, 2)."""
    down, right = np.mgrid[-steps : steps + 1, -steps : steps + 1]
    is_near = np.hypot(right, down) <= steps
    return np.asarray(velocity + np.stack([right[is_near], down[is_near]], axis=1) * step_px_s)


def _alike(events: Float32Array) -> Float32Array:
    """The shares of events that all count alike."""
    return np.ones(len(events), np.float32)


def _not_by_chance(events: int, speed_px_s: float, time_s: float) -> float:
    """The share of the agreement of so many events, for a motion at this speed since the start, that chance does not
    bring."""
    return math.exp(-(_rest_weight(events) * speed_px_s * time_s))


def _rest_weight(events: int) -> float:
    """How much coherence of so many events a pixel of motion since the start has to bring."""
    return REST_WEIGHT / math.sqrt(events)
