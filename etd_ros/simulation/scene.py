"""A scene of textured sprites that move along known paths over a textured background, and a camera that may move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.simulation.motion import Flicker, FloatArray, Path, SimulationError
from etd_ros.simulation.textures import Texture

OPAQUE = 0.5
"""Texture pixels of a larger opacity belong to the truth box."""


@dataclass(frozen=True, slots=True)
class Sprite:
    """A flat textured thing in front of the background.

    Attributes:
        name: unique; the target's name in the truth.
        texture: intensities, float64, shape (h, w).
        opacity: 1 where the sprite is, 0 where one sees through it, float64, shape (h, w).
        path: where its centre is.
        is_target: whether it belongs to the truth; an occluder does not.
        nearness: how far it shifts when the camera moves, over how far the background does; 0 moves with the camera.
        flicker: of a lamp.
        outline: corners of the convex hull of its opaque pixels (opacity > 0.5), from its centre (texture pixels),
            float64, shape (n, 2).
    """

    name: str
    texture: Texture
    opacity: npt.NDArray[np.float64]
    path: Path
    is_target: bool = True
    nearness: float = 1.0
    flicker: Flicker | None = None
    outline: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.texture.shape != self.opacity.shape:
            msg = f"sprite {self.name!r}: a texture of {self.texture.shape} with an opacity of {self.opacity.shape}"
            raise SimulationError(msg)
        object.__setattr__(self, "outline", self._outline())

    def _outline(self) -> FloatArray:
        rows, columns = np.nonzero(self.opacity > OPAQUE)
        if not len(rows):
            msg = f"sprite {self.name!r} is nowhere opaque: nothing of it would be seen"
            raise SimulationError(msg)
        pixels = np.stack([columns, rows], axis=1)
        corners = np.concatenate([pixels + corner for corner in ((0, 0), (0, 1), (1, 0), (1, 1))])
        hull = cv2.convexHull(corners.astype(np.int32))[:, 0].astype(np.float64)
        height, width = self.opacity.shape
        return np.asarray(hull - (width / 2, height / 2), np.float64)


@dataclass(frozen=True, slots=True)
class Scene:
    """Background and sprites, later ones in front of earlier ones.

    Attributes:
        width, height: sensor size (pixels).
        duration_s: how long it lasts.
        background: intensities, float64, shape (height, width), or any shape where there is a `view`: it continues
            mirrored beyond its edges.
        sprites: from the back to the front.
        view: how the camera moves: (x, y) is how far the background's centre has gone to the left and upwards, scale
            enlarges and angle turns the picture about the sensor's centre. None: it stands still.
        flicker: of the light of the whole scene.
        shade: how much light there is for each pixel, float64, shape (height, width), above 0. None: 1.
        dark: what the sensor sees where there is no light; with `shade` it takes the contrast from dark places.
    """

    width: int
    height: int
    duration_s: float
    background: Texture
    sprites: tuple[Sprite, ...]
    view: Path | None = None
    flicker: Flicker | None = None
    shade: npt.NDArray[np.float64] | None = None
    dark: float = 0.0

    def __post_init__(self) -> None:
        size = (self.height, self.width)
        if self.view is None and self.background.shape != size:
            msg = f"a background of {self.background.shape} for a sensor of {self.width}x{self.height}"
            raise SimulationError(msg)
        if self.shade is not None and self.shade.shape != size:
            msg = f"a shade of {self.shade.shape} for a sensor of {self.width}x{self.height}"
            raise SimulationError(msg)
        textures = [self.background, *(sprite.texture for sprite in self.sprites)]
        lights = [*textures, *([] if self.shade is None else [self.shade])]
        if min(float(light.min()) for light in lights) <= 0 or self.dark < 0:
            msg = "intensities must be above 0: events come from their logarithm"
            raise SimulationError(msg)
        names = [sprite.name for sprite in self.sprites]
        if len(set(names)) < len(names):
            msg = f"two sprites of one name among {', '.join(names)}: give each a name of its own"
            raise SimulationError(msg)

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the sprites that belong to the truth, from the back to the front."""
        return tuple(sprite.name for sprite in self.sprites if sprite.is_target)

    def render(self, time_s: float) -> npt.NDArray[np.float64]:
        """Log intensity, float64, shape (height, width)."""
        # Imported here: the renderer works on scenes.
        from etd_ros.simulation.rendering import Renderer

        renderer = Renderer(self, np.array([time_s]))
        renderer.advance(0)
        return renderer.after

    def placements(self, times_s: Sequence[float] | FloatArray) -> FloatArray:
        """Where the background (first) and the sprites are on the sensor.

        Args:
            times_s: seconds since the start of the scene, shape (n,).

        Returns:
            x, y (pixels), scale and angle (rad) of their centres, float64, shape (n, 1 + sprites, 4).
        """
        times = np.asarray(times_s, np.float64)
        centre = np.array([self.width / 2, self.height / 2])
        rest = np.array([[*centre, 1.0, 0.0]])
        poses = [np.repeat(rest, len(times), axis=0), *(sprite.path.poses(times) for sprite in self.sprites)]
        placed = np.stack(poses, axis=1)
        if self.view is None:
            return placed
        view = self.view.poses(times)[:, None, :]
        nearness = np.array([1.0, *(sprite.nearness for sprite in self.sprites)])[None, :, None]
        zoom, roll = view[..., 2], view[..., 3]
        x, y = np.moveaxis(placed[..., :2] - nearness * view[..., :2] - centre, 2, 0)
        placed[..., 0] = centre[0] + zoom * (np.cos(roll) * x - np.sin(roll) * y)
        placed[..., 1] = centre[1] + zoom * (np.sin(roll) * x + np.cos(roll) * y)
        placed[..., 2] *= zoom
        placed[..., 3] += roll
        return placed

    def box(self, name: str, time_s: float) -> Box:
        """The exact box of the whole sprite (pixels), hidden or not: the tightest round its opaque pixels.

        Raises:
            SimulationError: there is no such sprite.
        """
        index = self.index_of(name)
        return box_of(self.sprites[index], self.placements([time_s])[0, 1 + index])

    def index_of(self, name: str) -> int:
        """Where in `sprites` it stands.

        Raises:
            SimulationError: there is no such sprite.
        """
        for index, sprite in enumerate(self.sprites):
            if sprite.name == name:
                return index
        msg = f"no sprite {name!r}: the scene has {', '.join(sprite.name for sprite in self.sprites)}"
        raise SimulationError(msg)

    def visible_share(self, name: str, time_s: float) -> float:
        """The share of a sprite that lies on the sensor and is not hidden by sprites in front of it, 0 to 1."""
        from etd_ros.simulation.truth import visible_shares

        return float(visible_shares(self, name, [time_s]).visible[0])

    def boxes(self, time_s: float, *, visible_min: float = 0.5) -> dict[str, Box]:
        """Boxes of the targets of which at least `visible_min` can be seen, by name."""
        return {
            name: self.box(name, time_s) for name in self.targets if self.visible_share(name, time_s) >= visible_min
        }


def box_of(sprite: Sprite, placement: FloatArray) -> Box:
    """The tightest box (pixels) round the opaque pixels of a sprite at x, y, scale, angle (shape (4,))."""
    x, y, scale, angle = placement.tolist()
    cos, sin = np.cos(angle) * scale, np.sin(angle) * scale
    columns = x + sprite.outline @ (cos, -sin)
    rows = y + sprite.outline @ (sin, cos)
    left, top = float(columns.min()), float(rows.min())
    return Box(left, top, float(columns.max()) - left, float(rows.max()) - top)
