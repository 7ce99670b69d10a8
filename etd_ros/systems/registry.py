"""The systems of the comparison by name: what each one is, what it is fed with, and how it is made."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from etd_ros.errors import named
from etd_ros.settings import Settings
from etd_ros.systems.eco import EcoTracker
from etd_ros.systems.event_clusters import e_ms_maker
from etd_ros.systems.interface import CompareError, EventTracker, PictureTracker
from etd_ros.systems.opencv_trackers import kcf_maker, tld_maker
from etd_ros.systems.siamese import dasiamrpn_maker, siamfc_maker
from etd_ros.tracking import METHODS

Feed = Literal["engine", "video", "reconstruction", "atsltd", "events"]
"""What a system is given: `engine` makes frames and images of the events for itself, `video` is the camera's frames,
`reconstruction` high-pass images at 100 Hz, `atsltd` ATSLTD frames as grey pictures, `events` the events."""

PictureMaker = Callable[[Settings, int], Callable[[], PictureTracker]]
EventMaker = Callable[[Settings, int], Callable[[], EventTracker]]
"""From settings and a seed, what makes a tracker for each target. What a user can have got wrong is tried here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class System:
    """A row of the table.

    Attributes:
        name: on the command line and in results.
        description: one line for help texts and tables.
        feed: what it is given.
        is_random: whether its boxes depend on the seed.
    """

    name: str
    description: str
    feed: Feed
    is_random: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureSystem(System):
    """A system that is given pictures, of which `maker` makes the trackers."""

    maker: PictureMaker


@dataclass(frozen=True, slots=True, kw_only=True)
class EventSystem(System):
    """A system that is given events, of which `maker` makes the trackers."""

    maker: EventMaker


def _eco_maker(settings: Settings, seed: int) -> Callable[[], PictureTracker]:  # noqa: ARG001
    """ECO is not random and has the paper's parameters."""
    return EcoTracker


_KCF = "KCF (Henriques 2015) of OpenCV"
_TLD = "TLD (Kalal 2012) of OpenCV"
_DASIAMRPN = "DaSiamRPN (Zhu 2018)"
_ON_RECONSTRUCTIONS = "on high-pass reconstructions at 100 Hz"

SYSTEMS: dict[str, System] = {
    system.name: system
    for system in (
        *(System(name=method.name, description=method.description, feed="engine") for method in METHODS.values()),
        PictureSystem(name="kcf", description=f"{_KCF} on video", feed="video", maker=kcf_maker),
        PictureSystem(
            name="kcf-reconstruction",
            description=f"{_KCF} {_ON_RECONSTRUCTIONS}",
            feed="reconstruction",
            maker=kcf_maker,
        ),
        PictureSystem(name="tld", description=f"{_TLD} on video", feed="video", is_random=True, maker=tld_maker),
        PictureSystem(
            name="tld-reconstruction",
            description=f"{_TLD} {_ON_RECONSTRUCTIONS}",
            feed="reconstruction",
            is_random=True,
            maker=tld_maker,
        ),
        PictureSystem(name="siamfc", description="SiamFC (Bertinetto 2016) on video", feed="video", maker=siamfc_maker),
        PictureSystem(name="dasiamrpn", description=f"{_DASIAMRPN} on video", feed="video", maker=dasiamrpn_maker),
        PictureSystem(
            name="dasiamrpn-e", description=f"{_DASIAMRPN} on ATSLTD frames", feed="atsltd", maker=dasiamrpn_maker
        ),
        PictureSystem(
            name="eco",
            description="ECO (Danelljan 2017) with hand-crafted features on video",
            feed="video",
            maker=_eco_maker,
        ),
        EventSystem(
            name="e-ms",
            description="E-MS (Barranco 2018): mean-shift clusters of events and a Kalman filter",
            feed="events",
            maker=e_ms_maker,
        ),
    )
}
"""Every system by its name; the first ones are the engine's methods."""


def system_named(name: str) -> System:
    """The system of this name.

    Raises:
        CompareError: there is none; the message lists the known ones.
    """
    return named(SYSTEMS, name, "system", CompareError)
