"""Random scenes in which something thrown crosses the sensor once, in 0.1 to 0.9 s."""

from __future__ import annotations

import numpy as np

from etd_ros.simulation import things
from etd_ros.simulation.backgrounds import BACKGROUNDS
from etd_ros.simulation.motion import FloatArray, Path
from etd_ros.simulation.scene import Scene, Sprite
from etd_ros.simulation.sensor import SensorConfig

KINDS = (things.ball, things.ball, things.plain, things.irregular, things.dartboard)
SENSOR_SIZES = ((240, 180), (346, 260), (640, 480))
SMALLEST_PX, LARGEST_SHARE = 12, 0.3
"""Of what is thrown, its larger side in the middle of the flight: the least, and the most over the sensor's height."""
WIDTHS_S = 1.2, 8
"""How fast it is (widths of the sensor a second)."""
BEFORE_S = 0.05
"""The scene stands for so long before the flight, and twice as long after it."""
ROOM_PX = 40
"""What the background has beyond the sensor on each side, for the camera's motion."""


def thrown_scene(rng: np.random.Generator, bandwidth_hz: float = 0.0) -> tuple[Scene, SensorConfig]:
    """A scene with one target, and the sensor that sees it; `rng` decides all but the sensor's bandwidth (Hz).

    Raises:
        SimulationError: scikit-image, whose photographs are some of the backgrounds, is not installed.
    """
    width, height = SENSOR_SIZES[int(rng.integers(len(SENSOR_SIZES)))]
    size_px = float(np.exp(rng.uniform(np.log(SMALLEST_PX), np.log(LARGEST_SHARE * height))))
    path, duration_s = _flight(rng, width, height)
    kind = KINDS[int(rng.integers(len(KINDS)))]
    sprite = Sprite(kind.__name__, *kind(rng, round(size_px)), path)
    background = BACKGROUNDS[str(rng.choice(["wall", "cloudy", "clutter", "tiles", "photo"]))](
        rng, height + 2 * ROOM_PX, width + 2 * ROOM_PX
    )
    view = _view(rng, width, duration_s)
    if view is None:
        background = np.ascontiguousarray(background[ROOM_PX:-ROOM_PX, ROOM_PX:-ROOM_PX])
    sensor = SensorConfig(
        contrast_threshold=float(rng.uniform(0.15, 0.35)),
        threshold_spread=0.03,
        bandwidth_hz=bandwidth_hz,
        noise_rate_hz=float(np.exp(rng.uniform(np.log(500), np.log(20_000)))),
        step_s=0.005,
        step_px=0.6,
    )
    return Scene(width, height, duration_s, background, (sprite,), view=view), sensor


def _flight(rng: np.random.Generator, width: int, height: int) -> tuple[Path, float]:
    """The way of what is thrown, and how long the scene lasts (s)."""
    slowest, fastest = WIDTHS_S
    speed_px_s = float(np.exp(rng.uniform(np.log(slowest * width), np.log(fastest * width))))
    side, angle = rng.choice([-1, 1]), rng.uniform(-0.5, 0.5)
    right_px_s, down_px_s = side * speed_px_s * np.cos(angle), speed_px_s * np.sin(angle)
    flight_s = 0.95 * width / abs(right_px_s)
    way_x, way_y = right_px_s * flight_s, down_px_s * flight_s
    x, y = (width - way_x) / 2, (height - way_y) / 2 + rng.uniform(-0.2, 0.2) * height
    fall_px, growth, spin_rad_s = rng.uniform(0, 0.6) * height, rng.uniform(-0.7, 0.7), rng.uniform(-6, 6)
    duration_s = flight_s + 3 * BEFORE_S

    def pose(times_s: FloatArray) -> tuple[FloatArray, ...]:
        # It comes from beyond the border, and goes on beyond it.
        part = np.clip((times_s - BEFORE_S) / flight_s, -0.2, 1.3)
        fallen_px = fall_px * (0.5 * part**2 - 0.25 * part)
        return x + way_x * part, y + way_y * part + fallen_px, np.exp(growth * (part - 0.5)), spin_rad_s * times_s

    return Path.of(pose, duration_s), duration_s


def _view(rng: np.random.Generator, width: int, duration_s: float) -> Path | None:
    """How the camera moves; None: it stands still."""
    camera = str(rng.choice(["still", "still", "slide", "shake"]))
    speed_px_s, angle = rng.uniform(20, 100) * width / 240, rng.uniform(0, 2 * np.pi)

    def slide(times_s: FloatArray) -> tuple[FloatArray, ...]:
        way_px = np.minimum(speed_px_s * times_s, ROOM_PX - 5)
        return way_px * np.cos(angle), way_px * np.sin(angle)

    def shake(times_s: FloatArray) -> tuple[FloatArray, ...]:
        return 3 * np.sin(8 * np.pi * times_s + angle), 3 * np.sin(10.6 * np.pi * times_s)

    if camera == "still":
        return None
    return Path.of(slide if camera == "slide" else shake, duration_s)
