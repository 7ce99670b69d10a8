"""From event pixels to the edge map and the edge orientations that EdgeBoxes asks for."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

FloatImage = npt.NDArray[np.float32]

ORIENTATION_RADIUS = 4
"""Smoothing before the second derivatives (pixels)."""
THINNING_RADIUS = 1
"""Smoothing before thinning (pixels): decay along a thick contour is bumpy, and every bump would survive as an edge."""
NEIGHBOUR_DISTANCE = 2
"""How far across an edge a stronger pixel suppresses (pixels)."""
TIE_MARGIN = 1.01
"""A pixel this little weaker than its neighbour stays, so that a flat ridge does not fall apart."""


def edges_of(events: npt.NDArray[np.uint8], *, thin: bool) -> tuple[FloatImage, FloatImage]:
    """The edge map and orientation of a region.

    Args:
        events: combined channels of a frame's region, uint8, shape (h, w), 0 no event; not all zero.
        thin: suppress what is not the ridge of its contour; thick contours inflate boxes.

    Returns:
        The edge map, float32 (h, w) in [0, 1] with a maximum of 1 (EdgeBoxes' thresholds are absolute, and a map that
        stays below 0.1 gives no box), and the orientation as of `edge_orientation`.
    """
    edges = events.astype(np.float32) / np.float32(events.max())
    orientation = edge_orientation(edges)
    if thin:
        smooth = smoothed(edges, THINNING_RADIUS)
        edges = thin_edges(smooth, edge_orientation(smooth))
        edges /= edges.max()
    return edges, orientation


def smoothed(image: FloatImage, radius: int) -> FloatImage:
    """Convolution with the separable triangle (1 .. r+1 .. 1) / (r+1)^2, borders reflected; float32 (h, w)."""
    rising = np.arange(1, radius + 2, dtype=np.float32)
    kernel = np.concatenate([rising, rising[-2::-1]]) / np.float32((radius + 1) ** 2)
    return np.asarray(cv2.sepFilter2D(image, -1, kernel, kernel, borderType=cv2.BORDER_REFLECT), np.float32)


def edge_orientation(edges: FloatImage) -> FloatImage:
    """Direction across each edge (rad), in [0, pi): mod(atan(-Oyy sign(Oxy) / Oxx), pi) of the smoothed map.

    0 is a vertical edge, pi / 2 a horizontal one; between them the formula is off by up to 12 degrees, as EdgeBoxes
    is used to. float32, shape (h, w).
    """
    image = smoothed(edges, ORIENTATION_RADIUS)
    dx, dy = cv2.Sobel(image, -1, 1, 0), cv2.Sobel(image, -1, 0, 1)
    dxx, dxy, dyy = cv2.Sobel(dx, -1, 1, 0), cv2.Sobel(dx, -1, 0, 1), cv2.Sobel(dy, -1, 0, 1)
    # A sign of 0, as straight horizontal edges have it, would turn them into vertical ones.
    turn = np.where(dxy > 0, np.float32(-1), np.float32(1))
    angle = np.mod(np.arctan(dyy * turn / (dxx + np.float32(1e-5))), np.float32(np.pi))
    # float32's mod gives pi itself for tiny negative angles.
    return np.asarray(np.where(angle >= np.float32(np.pi), np.float32(0), angle), np.float32)


@njit(cache=True, nogil=True)
def thin_edges(edges: FloatImage, orientation: FloatImage) -> FloatImage:
    """Non-maximum suppression: keep a pixel unless one within 2 pixels across its edge is clearly stronger.

    Args:
        edges: edge map, float32, shape (h, w), h and w at least 2.
        orientation: direction across the edge (rad), float32, shape (h, w).

    Returns:
        A new map, float32, shape (h, w): `edges` where kept, else 0.
    """
    height, width = edges.shape
    thin = np.zeros_like(edges)
    for y in range(height):
        for x in range(width):
            strength = edges[y, x]
            if strength <= 0:
                continue
            step_x, step_y = math.cos(orientation[y, x]), math.sin(orientation[y, x])
            kept = True
            for distance in range(-NEIGHBOUR_DISTANCE, NEIGHBOUR_DISTANCE + 1):
                if distance == 0:
                    continue
                at_x = min(max(x + distance * step_x, 0.0), width - 1.0)
                at_y = min(max(y + distance * step_y, 0.0), height - 1.0)
                left, top = min(int(at_x), width - 2), min(int(at_y), height - 2)
                part_x, part_y = at_x - left, at_y - top
                upper = (1 - part_x) * edges[top, left] + part_x * edges[top, left + 1]
                lower = (1 - part_x) * edges[top + 1, left] + part_x * edges[top + 1, left + 1]
                if (1 - part_y) * upper + part_y * lower > strength * TIE_MARGIN:
                    kept = False
                    break
            if kept:
                thin[y, x] = strength
    return thin
