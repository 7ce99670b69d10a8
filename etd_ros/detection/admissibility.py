"""How far a proposal's area and aspect ratio are from the last box's (paper Sec. 3.3, Eq. score and phi)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box, BoxArray


def admissibility(boxes: BoxArray, last_box: Box) -> npt.NDArray[np.float64]:
    """phi(area ratio) * phi(aspect ratio) of each box to `last_box`, phi(x) = min(x, 1/x).

    Args:
        boxes: proposals, float64, shape (n, 4), of positive width and height.
        last_box: O_{i-1}, the target's box on the frame before.

    Returns:
        float64, shape (n,), in (0, 1]; 1 is a box of the same size. Where a box lies does not matter.
    """
    w, h = boxes[:, 2], boxes[:, 3]
    area_ratio = (last_box.w / w) * (last_box.h / h)
    aspect_ratio = (last_box.w / w) / (last_box.h / h)
    return _phi(area_ratio) * _phi(aspect_ratio)


def _phi(ratio: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.asarray(np.minimum(ratio, 1 / ratio), np.float64)
