"""The figures of conversion.md: how many events later than the plain per-event definition frames of recordings end.

    python scripts/measure_delays.py RECORDING ...

The oracle is that of the tests, looks after every event, and takes a minute or two a recording.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

ALL = 2**62


def main() -> None:
    """Print a row of the table for each recording."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recordings", type=Path, nargs="+", metavar="RECORDING")
    sys.path.insert(0, str(Path(__file__).parents[1] / "test" / "conversion"))
    from conversion_oracles import first_events
    from test_conversion_delay import delays

    print("| recording | frames ended by NZGE | median delay (events) | 90 % | largest delay |\n|-|-|-|-|-|")
    for recording in parser.parse_args().recordings:
        found = delays(first_events(recording, ALL), 1, ALL)
        median, most = np.quantile(found, [0.5, 0.9])
        print(f"| {recording.name} | {len(found)} | {median:.0f} | {most:.0f} | {max(found)} |", flush=True)


if __name__ == "__main__":
    main()
