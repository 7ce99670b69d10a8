"""The options that say which recording to read, the same for every command that reads one."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_recording_options(parser: argparse.ArgumentParser) -> None:
    """Add RECORDING, --topic and --size."""
    parser.add_argument("recording", type=Path, help="bag, .mcap, .db3, AEDAT4, .raw, events.txt or its folder")
    parser.add_argument("--topic", help="event topic, where a bag has several")
    parser.add_argument(
        "--size", type=parse_size, metavar="WIDTHxHEIGHT", help="sensor size, for text and raw files that do not tell"
    )


def add_replay_options(parser: argparse.ArgumentParser) -> None:
    """Add what `replay` takes, on the command line and as `ros2 run etd_ros replay`."""
    add_recording_options(parser)
    parser.add_argument("--rate", type=float, default=1.0, help="1 is the recorded pace, 2 twice as fast (default: 1)")
    parser.add_argument("--loop", action="store_true", help="start again at the end, until interrupted")
    parser.add_argument("--clock", action="store_true", help="publish the recording's time on /clock")
    parser.add_argument(
        "--wait-for", type=int, default=1, metavar="N", help="wait for N subscribers of the events (default: 1)"
    )


def parse_size(text: str) -> tuple[int, int]:
    """(width, height) from `WIDTHxHEIGHT`, for argparse."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        msg = f"{text!r} is not WIDTHxHEIGHT, as in 640x480"
        raise argparse.ArgumentTypeError(msg)
    return int(width), int(height)
