"""One target's state machine, many targets, and the methods by name (paper Sec. 3.3, tracking stage)."""

from etd_ros.tracking.contours import ContourConfig
from etd_ros.tracking.errors import TrackingError
from etd_ros.tracking.methods import METHODS, Method, method_named
from etd_ros.tracking.multi_tracker import MultiTracker
from etd_ros.tracking.target import Search, Target, TargetReport, TargetState, TrackerConfig

__all__ = [
    "METHODS",
    "ContourConfig",
    "Method",
    "MultiTracker",
    "Search",
    "Target",
    "TargetReport",
    "TargetState",
    "TrackerConfig",
    "TrackingError",
    "method_named",
]
