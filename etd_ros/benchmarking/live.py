"""The live node: what a robot that starts `pipeline` before its camera gets. ROS is imported only when it runs."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

from etd_ros.benchmarking.event_path import Effort
from etd_ros.benchmarking.report import Row
from etd_ros.benchmarking.streams import BenchmarkError

NEEDED = ("rclpy", "event_camera_msgs", "vision_msgs")


def live(effort: Effort, data: Path | None) -> Iterator[Row]:  # noqa: ARG001
    """All rows, one by one as they are measured, of a `pipeline` process over DDS on the loopback.

    Args:
        effort: how long to measure.
        data: not needed: the scenes are simulated, since their boxes must be known.

    Raises:
        BenchmarkError: ROS 2 is missing, or the node does not do its work.
    """
    missing = missing_ros()
    if missing is not None:
        msg = f"the live figures need ROS 2, but {missing} cannot be imported: run `make setup`, or source your ROS 2"
        raise BenchmarkError(msg)
    from etd_ros.benchmarking.live_bench import LiveBench, own_place
    from etd_ros.benchmarking.live_figures import FULL_LIVE, QUICK_LIVE, live_figures

    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="etd_ros_live_")))
        place = stack.enter_context(own_place())
        bench = stack.enter_context(LiveBench(place, folder))
        yield from live_figures(bench, FULL_LIVE if effort.rounds > 1 else QUICK_LIVE)


def missing_ros() -> str | None:
    """The first package that the live figures need and that is not there; None where all are."""
    return next((name for name in NEEDED if importlib.util.find_spec(name) is None), None)
