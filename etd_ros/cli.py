"""The command line: `python -m etd_ros COMMAND ...`."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Sequence

from etd_ros.commands.one_line_parser import EXIT_BAD_INPUT, OneLineParser
from etd_ros.errors import EtdError

COMMANDS = (
    "info",
    "track",
    "plot",
    "replay",
    "simulate",
    "demo",
    "parameters",
    "calibrate",
    "nzge",
    "benchmark",
    "evaluate",
    "label",
    "train",
)
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Bad input is one line on standard error and exit code 2."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = _parser(arguments).parse_args(arguments)
    try:
        return int(options.run(options))
    except EtdError as err:
        print(f"etd_ros: {' '.join(str(err).split())}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except BrokenPipeError:
        sys.stderr.close()
        return 0
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """All commands for the help; only the one that is asked for otherwise, since each imports its own libraries."""
    parser = OneLineParser(prog="python -m etd_ros", description="Bounding boxes from event cameras.")
    subparsers = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    wanted = [name for name in COMMANDS if name == next(iter(arguments), None)]
    for name in wanted or COMMANDS:
        importlib.import_module(f"etd_ros.commands.{name}").add(subparsers)
    return parser
