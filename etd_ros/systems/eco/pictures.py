"""Square and other patches of a picture, at any place and size."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.systems.interface import CompareError, Picture

GreyPicture = npt.NDArray[np.uint8]
"""uint8, shape (height, width)."""


def grey(picture: Picture) -> GreyPicture:
    """The picture's grey levels: the cameras beside event sensors are mostly grey, and ECO's colour features are a
    table learnt from photographs that cannot be shipped here.

    Raises:
        CompareError: it is neither grey nor BGR, not uint8, or empty.
    """
    shape = picture.shape
    if picture.dtype != np.uint8 or picture.size == 0 or not (len(shape) == 2 or (len(shape) == 3 and shape[2] == 3)):
        msg = (
            f"ECO was given a picture of {picture.dtype} and shape {shape}: give uint8 of shape (height, width), or "
            f"(height, width, 3) in BGR"
        )
        raise CompareError(msg)
    if len(shape) == 2:
        return picture
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8)


class Pyramid:
    """A grey picture and, made when needed, its halves, so that patches which are made smaller do not alias."""

    def __init__(self, picture: GreyPicture) -> None:
        self._levels = [picture]

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture (pixels)."""
        height, width = self._levels[0].shape
        return width, height

    def patch(
        self, center: tuple[float, float], size: tuple[float, float], shape: tuple[int, int]
    ) -> npt.NDArray[np.uint8]:
        """The part of the picture round `center` (column, row; pixels), resized; beyond the border its edge goes on.

        Args:
            center: its middle, to fractions of a pixel (a box's centre: the first pixel's middle is 0.5).
            size: width and height of the part (pixels).
            shape: rows and columns of the patch.

        Returns:
            uint8 of that shape.
        """
        rows, columns = shape
        level = self._level(min(size[0] / columns, size[1] / rows))
        reduction = 2.0**level
        step_x, step_y = size[0] / columns / reduction, size[1] / rows / reduction
        left = (center[0] - size[0] / 2) / reduction + step_x / 2 - 0.5
        top = (center[1] - size[1] / 2) / reduction + step_y / 2 - 0.5
        patch = cv2.warpAffine(
            self._levels[level],
            np.array([[step_x, 0, left], [0, step_y, top]]),
            (columns, rows),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        )
        return np.asarray(patch, np.uint8)

    def _level(self, step: float) -> int:
        """How often the picture is halved for one patch pixel in `step` of its pixels."""
        level = 0
        while step >= 2 and min(self._levels[level].shape) >= 2:
            step /= 2
            level += 1
            if level == len(self._levels):
                finer = self._levels[-1]
                height, width = finer.shape
                even = finer[: height // 2 * 2, : width // 2 * 2]
                half = cv2.resize(even, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
                self._levels.append(np.asarray(half, np.uint8))
        return level
