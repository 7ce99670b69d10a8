"""Events to frames: ATSLTD, fixed windows, fixed counts; the information in a frame; the noise filter before them."""

from etd_ros.conversion.atsltd import (
    PAPER_INTERVAL,
    AtsltdConfig,
    AtsltdConverter,
    Regions,
)
from etd_ros.conversion.fixed import FixedCountConfig, FixedCountConverter, FixedWindowConfig, FixedWindowConverter
from etd_ros.conversion.frame import ConversionError, Converter, Frame, FrameEnd
from etd_ros.conversion.noise import BackgroundActivityFilter, NoiseFilterConfig
from etd_ros.conversion.nzge import confidence_interval, interval_from_statistics, nzge

__all__ = [
    "PAPER_INTERVAL",
    "AtsltdConfig",
    "AtsltdConverter",
    "BackgroundActivityFilter",
    "ConversionError",
    "Converter",
    "FixedCountConfig",
    "FixedCountConverter",
    "FixedWindowConfig",
    "FixedWindowConverter",
    "Frame",
    "FrameEnd",
    "NoiseFilterConfig",
    "Regions",
    "confidence_interval",
    "interval_from_statistics",
    "nzge",
]
