"""The command line: `python -m etd_ros COMMAND ...`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from etd_ros.commands import demo, info, parameters, replay, simulate, track
from etd_ros.errors import EtdError

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command. Bad input is one line on standard error and exit code 2."""
    parser = argparse.ArgumentParser(prog="etd_ros", description="Bounding boxes from event cameras.")
    subparsers = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in (info, track, replay, simulate, demo, parameters):
        command.add(subparsers)
    options = parser.parse_args(arguments)
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
