"""Figures of the event path, the tracker and the live node, beside those of other packages where there are any."""

from etd_ros.benchmarking.event_path import FULL, QUICK, Effort, event_path
from etd_ros.benchmarking.live import live, missing_ros
from etd_ros.benchmarking.peers import missing_packages
from etd_ros.benchmarking.report import COMPARED, LIVE, Report, Row, as_json, check_writable, print_table, write
from etd_ros.benchmarking.scaling import scaling, scaling_png
from etd_ros.benchmarking.streams import RECORDINGS, BenchmarkError
from etd_ros.benchmarking.tracker import tracker

__all__ = [
    "COMPARED",
    "FULL",
    "LIVE",
    "QUICK",
    "RECORDINGS",
    "BenchmarkError",
    "Effort",
    "Report",
    "Row",
    "as_json",
    "check_writable",
    "event_path",
    "live",
    "missing_packages",
    "missing_ros",
    "print_table",
    "scaling",
    "scaling_png",
    "tracker",
    "write",
]
