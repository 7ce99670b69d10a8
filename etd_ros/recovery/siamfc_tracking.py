"""SiamFC as a tracker (Bertinetto et al. 2016, Sec. 3.1)."""

from __future__ import annotations

from typing import NamedTuple


class SiamFcGeometry(NamedTuple):
    """Of a SiamFC network.

    Attributes:
        exemplar_side, instance_side: sides of its crops (pixels).
        stride: distance of the places that it answers for (pixels of a crop).
        response_side: how many of them there are down and across.
    """

    exemplar_side: int
    instance_side: int
    stride: int
    response_side: int = 17


PUBLISHED_GEOMETRY, SMALL_GEOMETRY = SiamFcGeometry(127, 255, 8), SiamFcGeometry(63, 127, 4)
