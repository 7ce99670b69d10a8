"""`replay RECORDING`: publish a recording on ROS topics. ROS is imported only when it runs."""

from __future__ import annotations

import argparse

from etd_ros.commands.recording_options import add_recording_options
from etd_ros.errors import EtdError


class RosMissingError(EtdError):
    """A command that needs ROS 2 where there is none."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("replay", help="publish a recording on ROS topics", description=__doc__)
    add_arguments(parser)
    parser.set_defaults(run=run)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options, shared with `ros2 run etd_ros replay`."""
    add_recording_options(parser)
    parser.add_argument("--rate", type=float, default=1.0, help="1 is the recorded pace, 2 twice as fast (default: 1)")
    parser.add_argument("--loop", action="store_true", help="start again at the end, until interrupted")
    parser.add_argument("--clock", action="store_true", help="publish the recording's time on /clock")
    parser.add_argument(
        "--wait-for", type=int, default=1, metavar="N", help="wait for N subscribers of the events (default: 1)"
    )


def run(options: argparse.Namespace) -> int:
    """Replay.

    Raises:
        RosMissingError: rclpy cannot be imported.
    """
    try:
        from etd_ros.nodes import replay
    except ModuleNotFoundError as err:
        msg = f"replay needs ROS 2, but {err.name} cannot be imported: run `make setup`, or source your ROS 2"
        raise RosMissingError(msg) from err
    return replay.run(options)
