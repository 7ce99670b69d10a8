"""A scene of textured sprites that move along known paths over a textured background."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.interpolate import CubicSpline

from etd_ros.boxes import Box
from etd_ros.errors import EtdError
from etd_ros.simulation.textures import Texture


class SimulationError(EtdError):
    """A scene that cannot be simulated."""


@dataclass(frozen=True, slots=True)
class Waypoint:
    """Where a sprite's centre is at a time.

    Attributes:
        time_s: seconds since the start of the scene.
        x, y: the centre (pixels).
        scale: its size over that of its texture.
    """

    time_s: float
    x: float
    y: float
    scale: float = 1.0


class Path:
    """A smooth way through waypoints: cubic splines in time; a single waypoint stands still."""

    def __init__(self, waypoints: Sequence[Waypoint]) -> None:
        """Raise SimulationError where there is no waypoint, or the times do not increase."""
        times = [waypoint.time_s for waypoint in waypoints]
        if not times or any(later <= earlier for earlier, later in itertools.pairwise(times)):
            msg = f"a path needs waypoints at increasing times, not {times}"
            raise SimulationError(msg)
        values = np.array([(waypoint.x, waypoint.y, waypoint.scale) for waypoint in waypoints], np.float64)
        self._start = values[0]
        self._spline = CubicSpline(times, values) if len(times) > 1 else None
        self._first_s, self._last_s = times[0], times[-1]

    def at(self, time_s: float) -> tuple[float, float, float]:
        """(x, y, scale) of the centre (pixels); before the first and after the last waypoint it stays there."""
        if self._spline is None:
            x, y, scale = self._start
        else:
            x, y, scale = self._spline(min(max(time_s, self._first_s), self._last_s))
        return float(x), float(y), float(scale)


@dataclass(frozen=True, slots=True)
class Sprite:
    """A flat textured thing in front of the background.

    Attributes:
        name: unique; the target's name in the truth.
        texture: intensities, float64, shape (h, w).
        opacity: 1 where the sprite is, 0 where one sees through it, float64, shape (h, w).
        path: where its centre is.
        is_target: whether it belongs to the truth; an occluder does not.
    """

    name: str
    texture: Texture
    opacity: npt.NDArray[np.float64]
    path: Path
    is_target: bool = True

    def box(self, time_s: float) -> Box:
        """The exact box of the whole sprite (pixels), hidden or not."""
        x, y, scale = self.path.at(time_s)
        height, width = self.texture.shape
        return Box(x - width * scale / 2, y - height * scale / 2, width * scale, height * scale)


@dataclass(frozen=True, slots=True)
class Scene:
    """Background and sprites, later ones in front of earlier ones.

    Attributes:
        width, height: sensor size (pixels).
        duration_s: how long it lasts.
        background: intensities, float64, shape (height, width).
        sprites: from the back to the front.
    """

    width: int
    height: int
    duration_s: float
    background: Texture
    sprites: tuple[Sprite, ...]

    def __post_init__(self) -> None:
        if self.background.shape != (self.height, self.width):
            msg = f"a background of {self.background.shape} for a sensor of {self.width}x{self.height}"
            raise SimulationError(msg)
        if (
            min(float(texture.min()) for texture in (self.background, *(sprite.texture for sprite in self.sprites)))
            <= 0
        ):
            msg = "intensities must be above 0: events come from their logarithm"
            raise SimulationError(msg)

    def render(self, time_s: float) -> npt.NDArray[np.float64]:
        """Log intensity, float64, shape (height, width)."""
        image = self.background.copy()
        for sprite in self.sprites:
            x, y, scale = sprite.path.at(time_s)
            _paint(image, sprite.texture, sprite.opacity, x, y, scale)
        return np.log(image)

    def visible_share(self, name: str, time_s: float) -> float:
        """The share of a sprite that lies on the sensor and is not hidden by sprites in front of it, 0 to 1."""
        index = self._index_of(name)
        ones = np.ones((self.height, self.width))
        shown = np.zeros((self.height, self.width))
        target = self.sprites[index]
        _paint(shown, np.ones_like(target.texture), target.opacity, *target.path.at(time_s))
        whole = target.opacity.sum() * target.path.at(time_s)[2] ** 2
        for sprite in self.sprites[index + 1 :]:
            cover = np.zeros_like(ones)
            _paint(cover, np.ones_like(sprite.texture), sprite.opacity, *sprite.path.at(time_s))
            shown *= 1 - cover
        return float(shown.sum() / whole)

    def _index_of(self, name: str) -> int:
        for index, sprite in enumerate(self.sprites):
            if sprite.name == name:
                return index
        msg = f"no sprite {name!r}: the scene has {', '.join(sprite.name for sprite in self.sprites)}"
        raise SimulationError(msg)

    def boxes(self, time_s: float, *, visible_min: float = 0.5) -> dict[str, Box]:
        """Boxes of the targets of which at least `visible_min` can be seen, by name."""
        return {
            sprite.name: sprite.box(time_s)
            for sprite in self.sprites
            if sprite.is_target and self.visible_share(sprite.name, time_s) >= visible_min
        }


@njit(cache=True, nogil=True)
def _paint(
    image: npt.NDArray[np.float64],
    texture: npt.NDArray[np.float64],
    opacity: npt.NDArray[np.float64],
    x: float,
    y: float,
    scale: float,
) -> None:
    """Blend a texture over an image, in place, its centre at (x, y); bilinear between the texture's pixels."""
    height, width = image.shape
    rows, columns = texture.shape
    left, top = x - columns * scale / 2, y - rows * scale / 2
    for row in range(max(0, int(np.floor(top)) - 1), min(height, int(np.ceil(top + rows * scale)) + 1)):
        for column in range(max(0, int(np.floor(left)) - 1), min(width, int(np.ceil(left + columns * scale)) + 1)):
            v = (row + 0.5 - top) / scale - 0.5
            u = (column + 0.5 - left) / scale - 0.5
            v0, u0 = int(np.floor(v)), int(np.floor(u))
            alpha, colour = 0.0, 0.0
            for j in range(v0, v0 + 2):
                for i in range(u0, u0 + 2):
                    if 0 <= j < rows and 0 <= i < columns:
                        share = (1 - abs(v - j)) * (1 - abs(u - i)) * opacity[j, i]
                        alpha += share
                        colour += share * texture[j, i]
            image[row, column] = image[row, column] * (1 - alpha) + colour
