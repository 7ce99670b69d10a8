"""`demo`: three nodes and a replay over DDS on the bundled recording, with a live table, a video and a score."""

from __future__ import annotations

import argparse
from pathlib import Path

from etd_ros.commands.replay import RosMissingError

BUNDLED = Path(__file__).resolve().parents[2] / "bags" / "demo"


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("demo", help="watch the nodes track a recording", description=__doc__)
    parser.add_argument("--recording", type=Path, default=BUNDLED, help="recording (default: the bundled one)")
    parser.add_argument("--truth", type=Path, default=BUNDLED / "boxes.csv", help="its boxes (default: bundled)")
    parser.add_argument("--output", type=Path, default=Path("demo"), help="folder for results (default: %(default)s)")
    parser.add_argument("--rate", type=float, default=1.0, help="pace of the replay (default: %(default)g)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the demo.

    Raises:
        RosMissingError: rclpy cannot be imported.
    """
    try:
        from etd_ros.nodes import demo
    except ModuleNotFoundError as err:
        msg = f"the demo needs ROS 2, but {err.name} cannot be imported: run `make setup`, or source your ROS 2"
        raise RosMissingError(msg) from err
    return demo.run(options.recording, options.truth, options.output, options.rate)
