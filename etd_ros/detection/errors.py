"""What can go wrong in detection."""

from etd_ros.errors import EtdError


class DetectionError(EtdError):
    """Proposals that cannot be made: the OpenCV build, or a frame of the wrong form."""
