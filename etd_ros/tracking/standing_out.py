"""Whether what looks like a lost target stands out from what is round it.

Of a target with few edges, before much that moves, parts agree with the model in many places: there a look that is sure
by itself says little.
"""

from __future__ import annotations

import math

from etd_ros.tracking.contours import Contours
from etd_ros.tracking.surface import TimeSurface
from etd_ros.tracking.usual_looks import UsualLooks

RADIUS_PX = 6.0
"""Nearer than this is the same place; as far round each of the eight places the best one is sought."""
SETTLE_PX = 1.5
"""With the velocity that the target has there it may agree best this far away."""
STRAIGHT_PX, ACROSS_PX = 16.0, 12.0
ROUND = (
    *((-STRAIGHT_PX, 0.0), (STRAIGHT_PX, 0.0), (0.0, -STRAIGHT_PX), (0.0, STRAIGHT_PX)),
    *((-ACROSS_PX, -ACROSS_PX), (ACROSS_PX, -ACROSS_PX), (-ACROSS_PX, ACROSS_PX), (ACROSS_PX, ACROSS_PX)),
)
"""The places round it that it is compared with (pixels)."""
CONFIDENCE_MIN = 1e-3


def share_elsewhere(
    contours: Contours, surface: TimeSurface, usual: UsualLooks, x: float, y: float, enough: float
) -> float:
    """How sure the best look round a place (pixels) is, in parts of how sure one there is: above 1 the target would
    rather be elsewhere. Pose and velocity of the body are those that the target has there. More than `enough` is
    enough: no better place is sought then."""
    here = contours.look_at(surface, x, y, SETTLE_PX)
    sure = max(usual.confidence_of_lost(here), CONFIDENCE_MIN)
    share = 0.0
    for right, down in ROUND:
        other = contours.look_at(surface, here.x + right, here.y + down, RADIUS_PX)
        if math.hypot(other.x - here.x, other.y - here.y) > RADIUS_PX:
            share = max(share, usual.confidence_of_lost(other) / sure)
        if share > enough:
            break
    return share
