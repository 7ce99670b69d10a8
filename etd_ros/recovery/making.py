"""Which recovery tracker is used, and all that it needs, checked once."""

from __future__ import annotations

import logging
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from etd_ros.recovery.config import AUTO, COMPACT, NETWORKS, SIAMRPN, RecoveryConfig
from etd_ros.recovery.interface import RecoveryError, RecoveryTracker
from etd_ros.recovery.opencv import OpenCvRecovery, tracker_maker

LIBRARIES = ("torch", "safetensors")
FALLBACK = "csrt"
_logger = logging.getLogger(__name__)
_told: set[str] = set()


def make_recovery(config: RecoveryConfig | None = None) -> Callable[[], RecoveryTracker]:
    """What makes a recovery tracker for each target; everything that can fail is tried here.

    Raises:
        RecoveryError: a library is missing, this OpenCV lacks the tracker, or a model file is not named, not there, or
            not readable.
    """
    config = config or RecoveryConfig()
    name = chosen_tracker(config.tracker)
    if name in NETWORKS:
        return _siamese_maker(name, config)
    make_tracker = tracker_maker(name, config)
    return lambda: OpenCvRecovery(config, make_tracker)


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
    """A maker of trackers that share one network."""
    # torch takes seconds to import and memory to keep: only who asks for a network gets it.
    from etd_ros.recovery.matchers import CompactMatcher, Matcher, SiamRpnMatcher
    from etd_ros.recovery.siamese import SiameseRecovery
    from etd_ros.recovery.siamrpn import load_siamrpn
    from etd_ros.recovery.weights_file import SHIPPED, load_compact

    matcher: Matcher
    if name == SIAMRPN:
        if not config.siamrpn_model:
            msg = f"recovery tracker {SIAMRPN!r} needs a model: set the parameter siamrpn_model to a DaSiamRPN file"
            raise RecoveryError(msg)
        matcher = SiamRpnMatcher(load_siamrpn(Path(config.siamrpn_model)))
    else:
        matcher = CompactMatcher(load_compact(Path(config.compact_model) if config.compact_model else SHIPPED))
    return lambda: SiameseRecovery(matcher, config)
