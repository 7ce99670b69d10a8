"""Memory over long streams."""

from __future__ import annotations

import json
import os
import subprocess
import sys

GROWTH_MAX_MIB = 6.0
"""The allocator's own steps of 2 MiB now and then; a kilobyte a message would be 17 MiB."""


def test_minutes_of_stream_take_no_more_memory_than_its_first_seconds(repository):
    """3 minutes of 100 messages/s, with a lost one now and then."""
    arguments = ("--duration", "180", "--rate", "2e4", "--size", "64x48", "--json")
    command = [sys.executable, str(repository / "scripts" / "soak.py"), *arguments]
    environment = {**os.environ, "PYTHONPATH": str(repository)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True, env=environment)
    figures = json.loads(done.stdout)
    assert figures["events"] > 3_000_000
    assert figures["frames"] > 1000
    assert figures["restarts"] == 18
    assert figures["end_mib"] - figures["warm_mib"] < GROWTH_MAX_MIB
    assert figures["peak_mib"] - figures["warm_mib"] < GROWTH_MAX_MIB
