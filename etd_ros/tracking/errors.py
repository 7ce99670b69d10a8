"""What can go wrong in tracking."""

from etd_ros.errors import EtdError


class TrackingError(EtdError):
    """A target that cannot be started or stopped, frames of another sensor, or an unknown method."""
