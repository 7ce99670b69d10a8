"""`benchmark live` as a user runs it: real processes over DDS. The figures themselves are not tested."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from etd_ros.benchmarking import report
from etd_ros.benchmarking.live_figures import PLAYS_MAX, highest_sustained, keeps_up
from etd_ros.benchmarking.live_outcome import Outcome

PERCENTILES = tuple(f"latency{of}_p{percent}" for of in ("_floor", "", "_node") for percent in (50, 99))
OVERLOAD = {
    "overload_offered": "Mev/s",
    "overload_latency_p99": "ms",
    "overload_dropped": "% of messages",
    "overload_unimaged": "% of events",
    "overload_iou": "IoU",
    "overload_growth": "MiB",
}
UNITS = {
    **dict.fromkeys(PERCENTILES, "ms"),
    "latency_iou": "IoU",
    "start_to_ready": "s",
    "start_to_box": "s",
    "exit": "s",
    "idle_cpu": "% of a core",
    "sustained": "Mev/s",
    "sustained_unimaged": "% of events",
    "other_load": "% of the machine",
    **OVERLOAD,
}


def outcome(**changes) -> Outcome:
    """A play of a second without a fault."""
    after_s = np.linspace(0, 1, 101)
    right = {
        "published": 250,
        "duration_s": 1.0,
        "decoded": 250,
        "losses": {"lost messages": 0, "errors": 0},
        "unimaged": 0.0,
        "after_s": after_s,
        "latency_ms": np.full(101, 2.0),
        "iou": np.full(101, 0.9),
        "resident_mib": np.full(10, 300.0),
        "own_latency_ms": {50: 1.5, 99: 1.9},
    }
    return Outcome(**{**right, **changes})


def test_a_rate_is_sustained_without_losses_with_boxes_that_are_right_and_come_in_time():
    assert keeps_up(outcome(), 1_000_000, 1.0)
    iou, latency_ms = np.full(101, 0.9), np.full(101, 2.0)
    iou[80:], latency_ms[70:] = 0.1, 600.0
    faults = {
        "decoded": 249,
        "losses": {"lost messages": 0, "errors": 1},
        "duration_s": 1.1,
        "iou": iou,
        "latency_ms": latency_ms,
        "after_s": np.linspace(0, 0.6, 101),
    }
    for name, value in faults.items():
        assert not keeps_up(outcome(**{name: value}), 1_000_000, 1.0), name
    assert not keeps_up(outcome(after_s=np.empty(0), latency_ms=np.empty(0), iou=np.empty(0)), 1_000_000, 1.0)


def test_the_highest_rate_counts_that_is_kept_up_with_in_one_of_its_plays():
    plays = []

    def played(rate: int) -> Outcome:
        """Up to 4 Mev/s are kept up with, but never in the first play."""
        plays.append(rate)
        fails = rate > 4_000_000 or plays.count(rate) == 1
        return outcome(decoded=250 - fails, unimaged=rate / 1e6)

    rates = [step * 1_000_000 for step in range(1, 8)]
    assert highest_sustained(played, rates, 1.0) == (4_000_000, 4.0)
    assert plays.count(4_000_000) == 2
    assert plays.count(5_000_000) == PLAYS_MAX
    assert highest_sustained(lambda _: outcome(decoded=0), rates, 1.0) == (0, 0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where a short run writes its figures beside others."""
    path = tmp_path_factory.mktemp("benchmarks")
    tables = f"{report.TABLE_START}\nothers\n{report.TABLE_END}\n\n{report.LIVE_START}\nold\n{report.LIVE_END}\n"
    (path / "README.md").write_text(tables)
    return path


@pytest.fixture(scope="module")
def rows(repository, folder):
    """Those of a short run."""
    command = [sys.executable, "-m", "etd_ros", "benchmark", "live", "--quick", "--json", "--write", str(folder)]
    done = subprocess.run(command, cwd=repository, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)["rows"]


def test_every_figure_is_measured(rows):
    measured = [(row["what"], row["stream"]) for row in rows]
    streams = ("1 Mev/s, 100 msg/s", "1 Mev/s, 250 msg/s")
    assert {(what, stream) for what in PERCENTILES for stream in streams} <= set(measured)
    assert {what for what, _ in measured} == set(UNITS)
    assert [stream for what, stream in measured if what == "idle_cpu"] == [
        "subscribed, a target, no events",
        "1 Mev/s, 250 msg/s, nobody subscribed",
    ]
    assert len(set(measured)) == len(measured)


def test_the_figures_are_written_beside_those_of_other_groups(rows, folder):
    assert json.loads((folder / "live.json").read_text())["rows"] == rows
    lines = (folder / "README.md").read_text().splitlines()
    assert lines[:4] == [report.TABLE_START, "others", report.TABLE_END, ""]
    table = [line for line in lines if line.startswith("|")]
    assert table[0].startswith("| what | sensor | stream | ours | unit |")
    assert len(table) == 2 + len(rows)
    assert "old" not in lines
    assert sorted(path.name for path in folder.iterdir()) == ["README.md", "live.json"]


def test_a_node_takes_targets_before_it_has_a_box(rows):
    seconds = {row["what"]: row["value"] for row in rows}
    assert 0 < seconds["start_to_ready"] < seconds["start_to_box"]


def test_figures_are_possible_ones(rows):
    for row in rows:
        assert row["unit"] == UNITS[row["what"]]
        assert row["sensor"] == ("" if row["what"] == "other_load" else "240x180")
        assert (row["peer"], row["peer_value"], row["ratio"]) == (None, None, None)
        if row["what"].startswith(("latency", "start", "overload_latency")):
            assert row["value"] > 0
        if row["what"] in ("overload_dropped", "overload_unimaged", "sustained_unimaged"):
            assert 0 <= row["value"] <= 100
        if row["what"] == "overload_iou":
            assert 0 <= row["value"] <= 1
        if row["what"] == "latency_iou":
            assert 0.6 < row["value"] <= 1
        if row["what"] == "other_load":
            assert 0 <= row["value"] <= 100
        if row["what"] == "overload_offered":
            assert 0 < row["value"] < 50.5
    percentiles = {(row["what"], row["stream"]): row["value"] for row in rows if row["what"] in PERCENTILES}
    for (what, stream), value in percentiles.items():
        if what.endswith("p50"):
            assert value <= percentiles[what.replace("p50", "p99"), stream]


def test_without_ros_the_group_says_so_in_one_line(repository):
    code = "import sys; sys.modules['rclpy'] = None; from etd_ros.cli import main; sys.exit(main(sys.argv[1:]))"
    environment = {**os.environ, "PYTHONPATH": str(repository)}
    command = [sys.executable, "-c", code, "benchmark", "live", "--quick"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, env=environment)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "rclpy" in done.stderr
    assert "make setup" in done.stderr


def test_importing_the_benchmark_imports_no_ros(repository):
    code = "import sys, etd_ros.commands.benchmark; print('rclpy' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(repository)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env=environment)
    assert done.stdout == "False\n"


def test_without_ros_the_other_groups_are_measured_all_the_same(repository):
    code = (
        "import sys; sys.modules['rclpy'] = None\n"
        "from etd_ros.commands.benchmark import all_groups\n"
        "print(*all_groups())"
    )
    environment = {**os.environ, "PYTHONPATH": str(repository)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, env=environment)
    assert done.stdout == "event-path tracker\n"
    assert done.stderr == "live is not measured: it needs ROS 2, and rclpy cannot be imported\n"
