"""Which recovery tracker is used, and all that it needs, checked once."""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from etd_ros.recovery.config import AUTO, COMPACT, NETWORKS, SIAMRPN, RecoveryConfig
from etd_ros.recovery.interface import RecoveryError, RecoveryTracker
from etd_ros.recovery.matching import COMPACT_GEOMETRY, SIAMRPN_GEOMETRY, BackgroundMatcher, Matcher
from etd_ros.recovery.opencv import OpenCvRecovery, tracker_maker
from etd_ros.recovery.siamese import SiameseRecovery

LIBRARIES = ("torch", "safetensors")
FALLBACK = "csrt"
GEOMETRIES = {COMPACT: COMPACT_GEOMETRY, SIAMRPN: SIAMRPN_GEOMETRY}
_logger = logging.getLogger(__name__)
_told: set[str] = set()


def make_recovery(config: RecoveryConfig | None = None) -> Callable[[], RecoveryTracker]:
    """What makes a recovery tracker for each target; what a user can have got wrong is tried here.

    Raises:
        RecoveryError: a library is missing, this OpenCV lacks the tracker, or a model file is not named, not there,
            not readable, or of another network.
    """
    config = config or RecoveryConfig()
    name = chosen_tracker(config.tracker)
    if name in NETWORKS:
        return _siamese_maker(name, config)
    make_tracker = tracker_maker(name, config)
    return lambda: OpenCvRecovery(config, make_tracker)


def network_is_there(config: RecoveryConfig, timeout_s: float) -> bool:
    """Whether all that `make_recovery` loads beside its caller's work is loaded; waits so long for it (s).

    Raises:
        RecoveryError: as `make_recovery` does, or what is loaded cannot be.
    """
    name = chosen_tracker(config.tracker)
    return name not in NETWORKS or _matcher(name, config).wait(timeout_s)


def chosen_tracker(name: str) -> str:
    """The tracker that a name stands for: `auto` is the network where its libraries are; says once which.

    Raises:
        RecoveryError: a network is named whose libraries are missing.
    """
    missing = missing_libraries()
    if name != AUTO:
        if name in NETWORKS and missing:
            msg = (
                f"recovery tracker {name!r} needs {' and '.join(missing)}: pip install {' '.join(missing)}, or choose "
                f"another tracker ({FALLBACK})"
            )
            raise RecoveryError(msg)
        return name
    chosen = FALLBACK if missing else COMPACT
    if chosen not in _told:
        _told.add(chosen)
        reason = f" because {' and '.join(missing)} cannot be found" if missing else ""
        _logger.info("Lost targets are searched with the recovery tracker %r%s", chosen, reason)
    return chosen


def missing_libraries() -> list[str]:
    """Which libraries of the networks are not installed."""
    return [library for library in LIBRARIES if find_spec(library) is None]


def _siamese_maker(name: str, config: RecoveryConfig) -> Callable[[], RecoveryTracker]:
    """A maker of trackers that share one network.

    Files that a user names are read before this returns. What ships is loaded beside the node's start, which does not
    wait for torch: whoever searches first does, if it is not there yet.
    """
    if name == SIAMRPN and not config.siamrpn_model:
        msg = (
            f"recovery tracker {SIAMRPN!r} needs a model: set the parameter recovery.siamrpn_model to a DaSiamRPN file"
        )
        raise RecoveryError(msg)
    matcher = _matcher(name, config)
    return lambda: SiameseRecovery(matcher, config)


def _matcher(name: str, config: RecoveryConfig) -> BackgroundMatcher:
    file = config.siamrpn_model if name == SIAMRPN else config.compact_model
    return _network(name, file, modified_ns(file))


def modified_ns(file: str) -> int:
    """When a file was written (ns), 0 where there is none."""
    return Path(file).stat().st_mtime_ns if Path(file).is_file() else 0


@lru_cache(maxsize=len(NETWORKS))
def _network(name: str, file: str, modified_ns: int) -> BackgroundMatcher:  # noqa: ARG001
    """The network of a file, empty: the one that ships. A node that makes its trackers anew does not load it anew,
    unless the file has been written again."""
    matcher = BackgroundMatcher(GEOMETRIES[name], lambda: _load(name, file))
    if file:
        matcher.wait()
    return matcher


@contextmanager
def _made_to_stay() -> Iterator[None]:
    """What is made within stays as long as the process does: no garbage is looked for in it, neither now nor later.
    Each look through all that torch brings would hold up a frame by 0.1 s."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_enabled:
            gc.enable()


@_made_to_stay()
def _load(name: str, file: str) -> Matcher:
    """In the network's own thread.

    Raises:
        RecoveryError: torch or safetensors are broken, or the file is not one of the network's weights.
    """
    try:
        from etd_ros.recovery.matchers import CompactMatcher, SiamRpnMatcher, limit_threads
        from etd_ros.recovery.siamrpn import load_siamrpn
        from etd_ros.recovery.weights_file import SHIPPED, load_compact
    # Libraries that torch loads are missing or damaged.
    except (ImportError, OSError) as err:
        reason = " ".join(str(err).split())[:120]
        msg = (
            f"recovery tracker {name!r}: {' or '.join(LIBRARIES)} cannot be imported ({reason}): install them anew, or "
            f"choose another tracker ({FALLBACK})"
        )
        raise RecoveryError(msg) from err
    limit_threads()
    if name == SIAMRPN:
        return SiamRpnMatcher(load_siamrpn(Path(file)))
    return CompactMatcher(load_compact(Path(file) if file else SHIPPED))
