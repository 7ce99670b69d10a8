"""Memory, latency and boxes of a live node over loops of one recording."""

from __future__ import annotations

import importlib.util
import itertools
import json
import os
import subprocess
import sys

import pytest

from etd_ros.boxes import Box
from etd_ros.recordings import open_recording
from etd_ros.recordings.bag_writer import EVENT_PACKET_DEFINITION, EVENT_PACKET_TYPE, BagWriter
from msg_adapters import Detection

LOOPS = 5
SECONDS = 1
GROWTH_MAX_MIB = 5.0
"""From the second loop on: the allocator's own steps. The frames of one loop alone would be 27 MiB."""


@pytest.fixture(scope="module")
def recording(repository, tmp_path_factory):
    """The first second of the bundled recording."""
    path = tmp_path_factory.mktemp("soak") / "bag"
    with (
        open_recording(repository / "bags" / "demo") as demo,
        BagWriter(path, {EVENT_PACKET_TYPE: EVENT_PACKET_DEFINITION}) as bag,
    ):
        bag.add_topic(demo.topic, EVENT_PACKET_TYPE, reliable=False)
        for message in itertools.islice(demo.messages(), 100 * SECONDS):
            bag.write(message.topic, message.receive_ns, message.data)
    return path


@pytest.fixture(scope="module")
def soak_live(repository):
    """The script as a module."""
    spec = importlib.util.spec_from_file_location("soak_live", repository / "scripts" / "soak_live.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("times", ["again", "on"])
def test_every_loop_has_the_boxes_of_the_first_and_takes_no_more_memory(repository, recording, times):
    hours = LOOPS * SECONDS / 3600
    arguments = ("--recording", str(recording), "--hours", str(hours), "--times", times, "--json")
    command = [sys.executable, str(repository / "scripts" / "soak_live.py"), *arguments]
    environment = {**os.environ, "PYTHONPATH": str(repository)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(done.stdout)
    assert figures["loops"] == len(figures["resident_mib"]) == LOOPS
    assert figures["boxes"] > 100 * SECONDS
    assert figures["differing"] == []
    assert set(figures["losses"].values()) == {0}
    assert max(figures["resident_mib"]) - figures["resident_mib"][1] < GROWTH_MAX_MIB


def test_boxes_that_differ_or_are_missing_are_seen(soak_live):
    boxes = {stamp: (Detection("thing", Box(1.0, 2.0, 30.0, 40.0), 1.0, "thing"),) for stamp in (10, 20, 30)}
    first = soak_live.Loop(boxes, [1.0, 2.0, 3.0], 300.0)
    assert soak_live.figures_of(2, soak_live.Loop(dict(boxes), [1.0], 300.0), first)["stamps that differ"] == 0
    moved = (Detection("thing", Box(1.0, 2.5, 30.0, 40.0), 1.0, "thing"),)
    for others in ({**boxes, 20: moved}, {**boxes, 20: ()}, {10: boxes[10], 30: boxes[30]}, {**boxes, 40: moved}):
        assert soak_live.figures_of(2, soak_live.Loop(others, [1.0], 300.0), first)["stamps that differ"] == 1
