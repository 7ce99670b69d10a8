"""Events -> intensity images at the frames' stamps."""

from etd_ros.reconstruction.high_pass import HighPassConfig, HighPassFilter, ReconstructionError
from etd_ros.reconstruction.synchronised import SynchronisedReconstruction

__all__ = ["HighPassConfig", "HighPassFilter", "ReconstructionError", "SynchronisedReconstruction"]
