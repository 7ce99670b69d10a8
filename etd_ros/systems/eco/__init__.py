"""ECO-HC (Danelljan et al., CVPR 2017), one of the systems that the paper compares with."""

from etd_ros.systems.eco.config import EcoConfig
from etd_ros.systems.eco.tracker import EcoTracker

__all__ = ["EcoConfig", "EcoTracker"]
