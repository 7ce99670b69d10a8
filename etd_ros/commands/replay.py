"""`replay RECORDING`: publish a recording on ROS topics. ROS is imported only when it runs."""

from __future__ import annotations

import argparse

from etd_ros.commands.recording_options import add_replay_options
from etd_ros.errors import EtdError


class RosMissingError(EtdError):
    """A command that needs ROS 2 where there is none."""


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("replay", help="publish a recording on ROS topics", description=__doc__)
    add_replay_options(parser)
    parser.add_argument(
        "--ros-args", nargs=argparse.REMAINDER, default=[], metavar="...", help="all that follows is for ROS: -r A:=B"
    )
    parser.set_defaults(run=run)


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
    return replay.run(options, ["replay", "--ros-args", *options.ros_args])
