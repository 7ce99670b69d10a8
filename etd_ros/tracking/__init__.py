"""One target's state machine, many targets, and the methods by name (paper Sec. 3.3, tracking stage)."""

from etd_ros.tracking.box_network import BoxMisfit
from etd_ros.tracking.box_refinement import Corrector
from etd_ros.tracking.box_view import BoxView
from etd_ros.tracking.clicks import Click
from etd_ros.tracking.contour_config import ContourConfig
from etd_ros.tracking.discovery import Discovery, DiscoveryConfig
from etd_ros.tracking.errors import TrackingError
from etd_ros.tracking.methods import DEFAULT_METHOD, METHODS, Method, method_named
from etd_ros.tracking.multi_tracker import MultiTracker, check_target
from etd_ros.tracking.starter import Starter
from etd_ros.tracking.target import Search, Target, TargetReport, TargetState, TrackerConfig

__all__ = [
    "DEFAULT_METHOD",
    "METHODS",
    "BoxMisfit",
    "BoxView",
    "Click",
    "ContourConfig",
    "Corrector",
    "Discovery",
    "DiscoveryConfig",
    "Method",
    "MultiTracker",
    "Search",
    "Starter",
    "Target",
    "TargetReport",
    "TargetState",
    "TrackerConfig",
    "TrackingError",
    "check_target",
    "method_named",
]
