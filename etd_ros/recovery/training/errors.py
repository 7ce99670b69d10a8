"""The area's error."""

from etd_ros.errors import EtdError


class TrainingError(EtdError):
    """A training that cannot start or go on: settings, cache, or checkpoint."""
