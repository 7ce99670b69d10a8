"""The tracking methods by name: our own, the paper's ETD and its two variants (Sec. 4.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from etd_ros.errors import named
from etd_ros.tracking.errors import TrackingError

IMAGE_INTERVAL_S = 0.05


@dataclass(frozen=True, slots=True)
class Method:
    """How events become frames, and whether a lost target is searched for.

    Attributes:
        name: the name on the command line and in parameters.
        conversion: events to frames.
        recovers: a recovery tracker searches lost targets on reconstructed images.
        description: one line for help texts.
        image_interval_s: a target is remembered and searched on so few intensity images (s); 0: on that of every frame.
        contours: targets are followed by their contours, not chosen among proposals.
    """

    name: str
    conversion: Literal["atsltd", "atsltd_fine", "fixed_window"]
    recovers: bool
    description: str
    image_interval_s: float = 0.0
    contours: bool = False


METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        Method(
            "etd-plus",
            "atsltd_fine",
            True,
            "contours followed on fine ATSLTD frames, recovery",
            image_interval_s=IMAGE_INTERVAL_S,
            contours=True,
        ),
        Method("etd", "atsltd", True, "ATSLTD frames, recovery on reconstructed images: the paper's method"),
        Method("etd-nr", "atsltd", False, "ATSLTD frames, no recovery: a lost target stays lost"),
        Method("etd-ftw", "fixed_window", True, "frames of fixed 9 ms time windows, recovery"),
    )
}
"""Every method by its name."""

DEFAULT_METHOD = "etd-plus"


def method_named(name: str) -> Method:
    """The method of this name.

    Raises:
        TrackingError: there is none; the message lists the known ones.
    """
    return named(METHODS, name, "method", TrackingError)
