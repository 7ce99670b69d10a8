"""The compared Siamese trackers: SiamFC and DaSiamRPN, on whatever pictures they are given."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from etd_ros.boxes import Box
from etd_ros.recovery.interface import RecoveryError
from etd_ros.recovery.picture_trackers import make_siamfc, make_siamrpn
from etd_ros.settings import Settings
from etd_ros.systems.interface import Answer, CompareError, Picture, PictureTracker


class _Siamese(Protocol):
    def start(self, picture: Picture, box: Box) -> None: ...

    def update(self, picture: Picture) -> tuple[Box | None, float]: ...


class SiameseTracker:
    """A `PictureTracker` of one of recovery's networks."""

    def __init__(self, tracker: _Siamese) -> None:
        self._tracker = tracker

    def start(self, picture: Picture, box: Box) -> None:
        self._tracker.start(picture, box)

    def update(self, picture: Picture) -> Answer:
        return Answer(*self._tracker.update(picture))


def siamfc_maker(settings: Settings, seed: int = 0) -> Callable[[], PictureTracker]:  # noqa: ARG001
    """Makes SiamFC trackers, a target each, that share one network: of `recovery.siamfc_model`, or the small one.

    Nothing in it is random.

    Raises:
        CompareError: torch or safetensors are missing, or the file named is not one of SiamFC's weights.
    """
    return _maker(lambda: make_siamfc(settings.recovery))


def dasiamrpn_maker(settings: Settings, seed: int = 0) -> Callable[[], PictureTracker]:  # noqa: ARG001
    """Makes DaSiamRPN trackers, a target each, that share one network: of `recovery.siamrpn_model`, or the compact one.

    Nothing in it is random.

    Raises:
        CompareError: torch or safetensors are missing, or the file named is not one of the network's weights.
    """
    return _maker(lambda: make_siamrpn(settings.recovery))


def _maker(make: Callable[[], Callable[[], _Siamese]]) -> Callable[[], PictureTracker]:
    try:
        make_tracker = make()
    except RecoveryError as err:
        raise CompareError(str(err)) from err
    return lambda: SiameseTracker(make_tracker())
