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


NOTICE = """
from etd_ros.compile_notice import compile_notice
from etd_ros.warm_up import warm_up
with compile_notice(lambda: print("compiling")):
    warm_up(["stream"])
"""


def test_only_a_start_that_compiles_says_so_and_only_once(repository, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert [python(repository, "-c", NOTICE).stdout for _ in range(2)] == ["compiling\n", ""]


def test_a_first_start_says_that_it_compiles_and_the_next_finds_it_done(bench, tmp_path, monkeypatch):
    cache = tmp_path / "cache"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache))
    bench.start("reconstruction")
    bench.wait_until(lambda: "reconstruction" in bench.diagnostics, "the reconstruction runs")
    assert bench.log("reconstruction").count("compiling for this machine") == 1
    assert list(cache.rglob("*.nbi"))
    assert bench.end("reconstruction") == 0
    bench.diagnostics.clear()
    bench.start("reconstruction")
    bench.wait_until(lambda: "reconstruction" in bench.diagnostics, "it runs again")
    assert "compiling" not in bench.log("reconstruction")
