"""Finds a lost target on the reconstructed images."""

from etd_ros.recovery.config import RecoveryConfig
from etd_ros.recovery.interface import Found, RecoveryError, RecoveryTracker
from etd_ros.recovery.making import make_recovery, network_is_there

__all__ = ["Found", "RecoveryConfig", "RecoveryError", "RecoveryTracker", "make_recovery", "network_is_there"]
