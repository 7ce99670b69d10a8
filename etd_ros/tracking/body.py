"""A target as a body: where it is, how large and how turned, how all of that changes, and the box round it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from etd_ros.boxes import Box
from etd_ros.tracking.contour_kernels import ANGLE, SCALE, Float64Array
from etd_ros.tracking.look_pace import FAST_SIZES_PER_S
from etd_ros.tracking.model_box import ModelBox, Pose
from etd_ros.tracking.shape import reach_of
from etd_ros.tracking.steady_change import SteadyChange

Velocity = tuple[float, float]
"""x, y (pixels/s)."""

TURN_GAIN, GROWTH_GAIN = 0.3, 0.25
"""How much of a misfit is a misfit of the rate."""
SCALE_LIMITS = (0.2, 5.0)
FLIES_ON_MAX = 0.3
"""What is fast flies on as long as its velocity differs by less than this part of it."""
VELOCITY_PX = 2.0
VELOCITY_S = (0.004, 0.05)
"""The velocity is an average over so much motion, within these times."""


class Body:
    """Pose, motion and box of one target.

    Args:
        box: where it is, upright (pixels).
        stamp_ns: the time of that (ns).

    Attributes:
        pose, velocity: now.
        stamp_ns: the time of the pose (ns).
        turning: how fast it turns (rad/s).
        growing: how fast it grows (the logarithm of its scale, 1/s).
    """

    def __init__(self, box: Box, stamp_ns: int) -> None:
        self.pose: Pose = (*box.center, 1.0, 0.0)
        self.velocity: Velocity = (0.0, 0.0)
        self.stamp_ns = stamp_ns
        self.turning = SteadyChange(TURN_GAIN)
        self.growing = SteadyChange(GROWTH_GAIN)
        self._model_box = ModelBox(box.w, box.h)

    @property
    def size_px(self) -> tuple[float, float]:
        """Width and height of the box at scale 1 (pixels)."""
        return self._model_box.size_px

    @property
    def size_at_first(self) -> tuple[float, float]:
        """Width and height of the box (pixels), turned and grown as it is now, without what was put right of it."""
        return self._model_box.size_at_first(self.pose)

    @property
    def box(self) -> Box:
        """Its box (pixels)."""
        return self._model_box.of(self.pose)

    def box_at(self, x: float, y: float, times: float = 1.0) -> Box:
        """Its box if its centre is there (pixels), or one round the same middle so many times as wide and high."""
        return self._model_box.at(x, y, self.pose, times)

    @property
    def speed_px_s(self) -> float:
        """How fast it moves (pixels/s)."""
        return math.hypot(*self.velocity)

    @property
    def sizes_per_s(self) -> float:
        """How fast it moves in widths and in heights of its box, together (1/s): what a box that stays behind loses of
        its overlap."""
        return sizes_per_s(self.velocity, *self._model_box.size(self.pose))

    @property
    def is_fast(self) -> bool:
        """Whether it moves so fast that it does not come to a halt at once."""
        return self.sizes_per_s > FAST_SIZES_PER_S

    def flies_on_from(self, standing: Standing) -> bool:
        """Whether it is fast, and moves about as when it stood there: what passes before it moves otherwise, though
        what lies behind it changes what it looks like."""
        return self.is_fast and math.dist(self.velocity, standing.velocity) < FLIES_ON_MAX * self.speed_px_s

    @property
    def motion(self) -> Float64Array:
        """How it moves, turns and grows: pixels/s, pixels/s, rad/s and 1/s."""
        return np.array([*self.velocity, self.turning.per_s, self.growing.per_s])

    def since_s(self, stamp_ns: int) -> float:
        """From the time of its pose to another one (s)."""
        return (stamp_ns - self.stamp_ns) * 1e-9

    def predicted(self, stamp_ns: int) -> tuple[float, float]:
        """Where its centre is at a time (ns), if the motion goes on (pixels)."""
        (x, y, _, _), (right, down), since_s = self.pose, self.velocity, (stamp_ns - self.stamp_ns) * 1e-9
        return x + right * since_s, y + down * since_s

    def changed(self, stamp_ns: int) -> tuple[float, float]:
        """Scale and angle (rad) at a time (ns), if growing and turning go on."""
        since_s = self.since_s(stamp_ns)
        _, _, scale, angle = self.pose
        return scale * math.exp(self.growing.per_s * since_s), angle + self.turning.per_s * since_s

    def velocity_to(self, x: float, y: float, stamp_ns: int) -> Velocity:
        """The velocity, x and y (pixels/s), if it goes to a place (pixels) by a time (ns): an average of that so far
        and of the way there."""
        elapsed_s = self.since_s(stamp_ns)
        if elapsed_s <= 0:
            return self.velocity
        shortest_s, longest_s = VELOCITY_S
        average_s = min(max(VELOCITY_PX / max(self.speed_px_s, 1e-3), shortest_s), longest_s)
        here_x, here_y, _, _ = self.pose
        last = (x - here_x) / elapsed_s, (y - here_y) / elapsed_s
        return nearer(self.velocity, last, elapsed_s / (elapsed_s + average_s))

    def go_to(self, x: float, y: float, stamp_ns: int, gain: float) -> None:
        """Be at a place (pixels) at a time (ns); the velocity follows by `gain`, 0 to 1."""
        self.velocity = nearer(self.velocity, self.velocity_to(x, y, stamp_ns), gain)
        self.pose = x, y, *self.changed(stamp_ns)
        self.stamp_ns = stamp_ns

    def be_at(self, x: float, y: float) -> None:
        """Be at a place (pixels), as large and turned as before."""
        _, _, scale, angle = self.pose
        self.pose = x, y, scale, angle

    def turn_to(self, angle_rad: float) -> None:
        """Be turned so far (rad)."""
        x, y, scale, _ = self.pose
        self.pose = x, y, scale, angle_rad

    def go_on_at(self, velocity: Velocity, gain: float) -> None:
        """Move at a velocity (pixels/s), by `gain` from 0 to 1, and neither turn nor grow."""
        self.velocity = nearer(self.velocity, velocity, gain)
        self.turning.stop()
        self.growing.stop()

    def stop(self) -> None:
        """Be at rest."""
        self.velocity = 0.0, 0.0
        self.turning.stop()
        self.growing.stop()

    def grow(self, growth: float) -> None:
        """Change the scale's logarithm, within limits."""
        self._scale_to(self.pose[SCALE] * math.exp(growth))

    def _scale_to(self, scale: float) -> None:
        """Be of this scale, within limits."""
        x, y, _, angle = self.pose
        least, most = SCALE_LIMITS
        self.pose = x, y, min(max(scale, least), most), angle

    def grow_on(self, growth: float) -> None:
        """Change the scale's logarithm, and believe that it has come to be off by its rate as well."""
        self.grow(growth)
        self.growing.correct(growth)

    def change_since(self, pose: Pose, growing_per_s: float, turning_rad_s: float, time_s: float) -> None:
        """It has grown and turned at these rates (1/s, rad/s) for a time (s), from the scale and angle of a pose."""
        self.turning.per_s = turning_rad_s
        self.growing.per_s = growing_per_s
        x, y, _, _ = self.pose
        self.pose = x, y, pose[SCALE], pose[ANGLE] + turning_rad_s * time_s
        self.grow(growing_per_s * time_s)

    def appear(self, box: Box, angle_rad: float, stamp_ns: int) -> None:
        """Be in a box (pixels) at a time (ns), turned so far, and lie in it as at the start."""
        self.pose = *box.center, 1.0, angle_rad
        self._model_box.reset()
        upright = self.box
        self._scale_to(math.sqrt(box.w * box.h / (upright.w * upright.h)))
        self.stamp_ns = stamp_ns

    def take_shape(self, places: Float64Array) -> None:
        """Learn the shape from where events are beside the middle (pixels at scale 1, shape (n, 2))."""
        self._model_box.take_shape(reach_of(places / np.divide(self.size_px, 2)))

    def correct_box(self, right: float, below: float, wider: float, higher: float) -> None:
        """Move the box by so many pixels, and make it so much wider and higher (logarithms); the pose stays."""
        self._model_box.correct(right, below, wider, higher, self.pose)


def sizes_per_s(velocity: Velocity, width: float, height: float) -> float:
    """How fast a velocity (pixels/s) is in so many widths and heights (pixels), as `Body.sizes_per_s`."""
    right, down = velocity
    return abs(right) / width + abs(down) / height


def nearer(velocity: Velocity, other: Velocity, share: float) -> Velocity:
    """A velocity moved towards another one by a share of the way, 0 to 1."""
    (right, down), (other_right, other_down) = velocity, other
    return right + share * (other_right - right), down + share * (other_down - down)


def pair(xy: Float64Array) -> tuple[float, float]:
    """A place or a velocity, of which an array holds x and y."""
    x, y = xy.tolist()
    return x, y


def moved_on(x: float, y: float, velocity: Velocity, since_ns: int) -> tuple[float, float]:
    """Where a motion (pixels/s) has brought a place (pixels) after a time (ns)."""
    right, down = velocity
    return x + right * since_ns * 1e-9, y + down * since_ns * 1e-9


@dataclass(frozen=True, slots=True)
class Standing:
    """Where a target stood: at stamp_ns its pose and velocity, as those of `Body`."""

    stamp_ns: int
    pose: Pose
    velocity: Velocity

    @classmethod
    def of(cls, body: Body) -> Standing:
        """Where it stands now."""
        return cls(body.stamp_ns, body.pose, body.velocity)

    def predicted(self, stamp_ns: int) -> tuple[float, float]:
        """Where its centre is at a time (ns), if the motion goes on (pixels)."""
        x, y, _, _ = self.pose
        return moved_on(x, y, self.velocity, stamp_ns - self.stamp_ns)
