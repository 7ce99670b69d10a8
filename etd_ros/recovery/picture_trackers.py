"""SiamFC and DaSiamRPN as trackers of pictures, with the weights that a user names or those that ship.

Each network runs in a thread of its own, which a forked process would not have: make trackers in the process that uses
them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path

from etd_ros.recovery.config import RecoveryConfig
from etd_ros.recovery.interface import RecoveryError
from etd_ros.recovery.making import LIBRARIES, missing_libraries, modified_ns
from etd_ros.recovery.matching import COMPACT_GEOMETRY, SIAMRPN_GEOMETRY, BackgroundMatcher, BackgroundSiamFc, Matcher
from etd_ros.recovery.siamfc_tracking import PUBLISHED_GEOMETRY, SMALL_GEOMETRY, SiamFcNetwork, SiamFcTracker
from etd_ros.recovery.siamrpn_tracking import BIG, COMPACT, OTB, VOT, Scoring, SiamRpnTracker

SIAMFC, DASIAMRPN = "siamfc", "dasiamrpn"


def make_siamfc(config: RecoveryConfig) -> Callable[[], SiamFcTracker]:
    """A maker of trackers that share one network.

    Raises:
        RecoveryError: torch or safetensors are missing or broken, or the file named is not one of SiamFC's weights.
    """
    file = config.siamfc_model
    with _libraries(SIAMFC):
        network = _siamfc(file, modified_ns(file))
    return lambda: SiamFcTracker(network)


def make_siamrpn(config: RecoveryConfig) -> Callable[[], SiamRpnTracker]:
    """A maker of trackers that share one network: DaSiamRPN's where `siamrpn_model` names it, else the compact one.

    Raises:
        RecoveryError: torch or safetensors are missing or broken, the file named is not one of its weights, or it is
            named by the parameter of OpenCV's tracker of the same name, which is not chosen.
    """
    if config.dasiamrpn_model and not config.siamrpn_model and config.tracker != DASIAMRPN:
        msg = (
            f"dasiamrpn_model {config.dasiamrpn_model} is for OpenCV's recovery tracker {DASIAMRPN!r}: name weights "
            f"of the compared system {DASIAMRPN!r} with siamrpn_model"
        )
        raise RecoveryError(msg)
    if file := config.siamrpn_model:
        with _libraries(DASIAMRPN):
            published, scoring = _published(file, modified_ns(file))
        return lambda: SiamRpnTracker(published, scoring)
    compact = compact_network(config.compact_model)
    return lambda: SiamRpnTracker(compact, COMPACT)


def compact_network(file: str) -> BackgroundMatcher:
    """The compact network of a file, empty: the one that ships; loaded once.

    Raises:
        RecoveryError: torch or safetensors are missing or broken, or the file is not one of its weights.
    """
    with _libraries(DASIAMRPN):
        return _compact(file, modified_ns(file))


@contextmanager
def _libraries(name: str) -> Iterator[None]:
    """Where networks are loaded: their libraries are looked for before, and broken ones told in one line."""
    if missing := missing_libraries():
        msg = f"{name} needs {' and '.join(missing)}: pip install {' '.join(missing)}, or compare without {name}"
        raise RecoveryError(msg)
    try:
        yield
    # Libraries that torch loads are missing or damaged.
    except (ImportError, OSError) as err:
        reason = " ".join(str(err).split())[:120]
        msg = f"{name}: {' or '.join(LIBRARIES)} cannot be imported ({reason}): install them anew"
        raise RecoveryError(msg) from err


# Trackers made anew share a network until its file has been written again.
@lru_cache(maxsize=1)
def _siamfc(file: str, modified_ns: int) -> BackgroundSiamFc:  # noqa: ARG001
    def load() -> SiamFcNetwork:
        from etd_ros.recovery.matchers import SiamFcMatcher, limit_threads
        from etd_ros.recovery.siamfc import SHIPPED, load_siamfc

        limit_threads()
        return SiamFcMatcher(load_siamfc(Path(file) if file else SHIPPED))

    is_small = not file or Path(file).suffix == ".safetensors"
    network = BackgroundSiamFc(SMALL_GEOMETRY if is_small else PUBLISHED_GEOMETRY, load)
    network.wait()
    return network


@lru_cache(maxsize=1)
def _published(file: str, modified_ns: int) -> tuple[BackgroundMatcher, Scoring]:  # noqa: ARG001
    is_big = False

    def load() -> Matcher:
        from etd_ros.recovery.matchers import SiamRpnMatcher, limit_threads
        from etd_ros.recovery.siamrpn import load_siamrpn

        nonlocal is_big
        limit_threads()
        matcher = SiamRpnMatcher(load_siamrpn(Path(file)), every_anchor=True)
        is_big = matcher.is_big
        return matcher

    matcher = BackgroundMatcher(SIAMRPN_GEOMETRY, load)
    matcher.wait()
    # The networks of SiamRPNVOT and SiamRPNOTB are of one size: only their names tell them apart.
    return matcher, BIG if is_big else OTB if "siamrpnotb" in Path(file).name.lower() else VOT


@lru_cache(maxsize=1)
def _compact(file: str, modified_ns: int) -> BackgroundMatcher:  # noqa: ARG001
    def load() -> Matcher:
        from etd_ros.recovery.matchers import CompactMatcher, limit_threads
        from etd_ros.recovery.weights_file import SHIPPED, load_compact

        limit_threads()
        return CompactMatcher(load_compact(Path(file) if file else SHIPPED))

    matcher = BackgroundMatcher(COMPACT_GEOMETRY, load)
    matcher.wait()
    return matcher
