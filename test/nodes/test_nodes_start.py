"""What a node has done before its first message comes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("first_messages.py")


def python(repository: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(repository)}
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False, env=environment)


def left_to_compile(node: str, repository: Path, data: Path) -> list[str]:
    done = python(repository, str(SCRIPT), node, str(data))
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.parametrize("node", ["accumulator", "reconstruction", "tracker", "pipeline"])
def test_after_the_warm_up_the_first_messages_of_every_encoding_find_all_kernels_ready(repository, data, node):
    assert left_to_compile(node, repository, data) == []


def test_without_it_they_would_not(repository, data):
    left = {line.split()[0] for line in left_to_compile("nothing", repository, data)}
    assert {"msg_adapters.codecs.evt3._decode", "etd_ros.stream._ordered_length"} <= left
    assert any(name.startswith("etd_ros.reconstruction") for name in left)
    assert any(name.startswith("etd_ros.detection") for name in left)


@pytest.mark.parametrize("node", ["accumulator", "reconstruction", "tracker", "pipeline"])
def test_a_node_loads_no_library_that_it_does_not_use(repository, node):
    code = f"import sys, etd_ros.nodes.{node}; print(*(name.partition('.')[0] for name in sys.modules))"
    done = python(repository, "-c", code)
    loaded = set(done.stdout.split())
    assert {"numba", "rclpy"} <= loaded
    assert not loaded & {"rosbags", "aedat", "matplotlib", "skimage", "rich"}


def test_a_first_start_says_that_it_compiles_and_runs_then(bench, tmp_path, monkeypatch):
    cache = tmp_path / "cache"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    bench.start("reconstruction")
    bench.wait_until(lambda: "reconstruction" in bench.diagnostics, "the reconstruction runs")
    assert bench.log("reconstruction").count("compiling for this machine") == 1
    assert list(cache.rglob("*.nbi"))
