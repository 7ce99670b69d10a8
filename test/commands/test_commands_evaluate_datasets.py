"""`evaluate --dataset`: tables of labelled recordings, resumed after whatever ended the last run."""

from __future__ import annotations

import csv
import os
import select
import shutil
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest
from evaluation_sequences import write_sequence

from etd_ros.cli import main

CELLS = 202
"""Of `started`: two sequences, of which one has no video."""
SYSTEMS = ("etd-nr", "kcf", "kcf-reconstruction")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Path:
    """Two sequences, one of them without video."""
    folder = tmp_path_factory.mktemp("dataset")
    write_sequence(folder, "shapes_6dof")
    write_sequence(folder, "blind", video=False)
    return folder


def arguments(dataset: Path, *more: str, systems=SYSTEMS) -> list[str]:
    return ["evaluate", "--dataset", "folder", str(dataset), "--systems", *systems, *more]


def test_a_dataset_gives_a_table_and_says_what_brought_no_result(dataset, tmp_path, capsys):
    output = tmp_path / "new" / "results"
    assert main(arguments(dataset, "--output", str(output), "--protocol", "both", "--jobs", "2")) == 0
    printed = capsys.readouterr()
    lines = printed.out.splitlines()
    assert lines[0] == "one-pass"
    assert lines[1].split() == ["blind", "shapes_6dof", "paper", "mean", "time"]
    kcf = next(line.split() for line in lines if line.startswith("kcf "))
    assert (kcf[1:3], kcf[5:7]) == (["–", "–"], ["0.307", "0.430"])
    assert float(kcf[3]) > 0.5
    assert any("kcf: no result for 2 cells: system 'kcf' needs video" in line for line in lines)
    assert "12/12 folder/" in printed.err
    written = {path.name for path in output.iterdir()}
    assert {
        "cells.csv",
        "evaluation.sqlite",
        *(f"table_{p}.{s}" for p in ("one-pass", "restarts") for s in ("md", "tex", "csv")),
    } <= written
    with (output / "cells.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert {row["system"] for row in rows if row["error"]} == {"kcf"}


def test_what_is_done_is_not_done_again_and_errors_only_when_asked_for(dataset, tmp_path, capsys):
    store = ("--store", str(tmp_path / "cells.sqlite"))
    assert main(arguments(dataset, *store, systems=("kcf",))) == 0
    first = capsys.readouterr()
    assert main(arguments(dataset, *store)) == 0
    again = capsys.readouterr().err.splitlines()
    assert again[0] == "2 of 6 cells are done already"
    assert [line.split()[:3] for line in again[1:]] == [
        ["3/6", "folder/blind/square", "etd-nr"], ["4/6", "folder/blind/square", "kcf-reconstruction"],
        ["5/6", "folder/shapes_6dof/square", "etd-nr"], ["6/6", "folder/shapes_6dof/square", "kcf-reconstruction"],
    ]  # fmt: skip
    assert main(arguments(dataset, *store, "--retry-errors", systems=("kcf",))) == 0
    retried = capsys.readouterr()
    assert retried.out == first.out
    assert [line.split()[0] for line in retried.err.splitlines()] == ["1", "2/2"]


def test_cells_with_other_settings_or_another_recording_are_done_anew(dataset, tmp_path, capsys):
    copy = tmp_path / "copy"
    shutil.copytree(dataset, copy)
    more = ("--store", str(tmp_path / "cells.sqlite"), "--only", "blind")
    done = []
    for change in ((), ("--set", "tracking.failure_iou=0.5"), (), None):
        if change is None:
            with (copy / "blind" / "events.txt").open("a") as file:
                file.write("0.6 1 1 1\n")
        assert main(arguments(copy, *more, *(change or ()), systems=("etd-nr",))) == 0
        done.append("1 of 1 cells are done already" in capsys.readouterr().err)
    assert done == [False, False, True, False]


def started(dataset: Path, store: Path) -> subprocess.Popen:
    """The command in a process and a group of its own, with more cells than it will come to."""
    more = ("--store", str(store), "--jobs", "2", "--repetitions", "100")
    command = [
        sys.executable,
        "-m",
        "etd_ros",
        *arguments(dataset, *more, systems=("etd-nr", "tld")),
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)


def children_of(pid: int) -> list[int]:
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def kept(store: Path) -> list[tuple]:
    with sqlite3.connect(store) as database:
        return database.execute("SELECT system, sequence, protocol, repetition, id FROM cells ORDER BY id").fetchall()


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGKILL, -9)])
def test_a_run_that_is_ended_goes_on_where_it_was(dataset, tmp_path, number, code):
    store = tmp_path / "cells.sqlite"
    with started(dataset, store) as running:
        lines = [running.stderr.readline() for _ in range(5)]
        descriptors = [os.pidfd_open(child) for child in children_of(running.pid)]
        # As a terminal does on Ctrl-C: to the whole group, in which the processes for cells are not.
        os.killpg(running.pid, number)
        assert running.wait() == code
        rest = running.stderr.read().splitlines()
    assert lines[-1].startswith("5/")
    for descriptor in descriptors:
        assert select.select([descriptor], [], [], 60)[0], "a process for cells has outlived its run"
        os.close(descriptor)
    assert len(descriptors) == 2
    if number == signal.SIGINT:
        assert len(rest) <= 2
        assert f"kept in {store}, run the same command again to go on" in rest[-1]
    before = kept(store)
    assert 5 <= len(before) < CELLS
    with started(dataset, store) as running:
        said = [running.stderr.readline() for _ in range(3)]
        os.killpg(running.pid, signal.SIGKILL)
    assert said[0] == f"{len(before)} of {CELLS} cells are done already\n"
    assert said[1].startswith(f"{len(before) + 1}/{CELLS} ")
    after = kept(store)
    assert after[: len(before)] == before
    assert len({row[:4] for row in after}) == len(after)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (("--systems", "guess"), "unknown system 'guess'"),
        (("--repetitions", "0"), "--repetitions 0"),
        (("--jobs", "0"), "--jobs 0"),
        (("--cell-timeout", "0"), "--cell-timeout 0"),
        (("--cell-timeout", "inf"), "--cell-timeout inf is out of range"),
        (("--cell-timeout", "1e10"), "--cell-timeout 1e+10 is out of range"),
        (("--scheduler", "foo"), "--scheduler foo: is no address"),
        (("--only", "moon"), "--only moon: no dataset has this sequence: choose of blind, shapes_6dof"),
        (("--set", "moon=1"), "moon"),
        (("--method", "etd"), "--method means nothing with --dataset"),
        (("--box-columns", "t,x,y,w,h"), "--box-columns"),
        (("--store", "."), "."),
        (("--output", "/proc/results"), "/proc/results"),
        (("--dataset", "moon", "."), "dataset 'moon' is unknown"),
        (("--dataset", "folder", "/nowhere"), "/nowhere"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_line(dataset, place, capsys, more, message):
    assert main(["evaluate", "--dataset", "folder", str(dataset), *more]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert list(place.iterdir()) == []


@pytest.mark.parametrize(
    ("systems", "setting"),
    [
        (("kcf", "siamfc"), "siamfc_model"),
        (("dasiamrpn",), "siamrpn_model"),
        (("dasiamrpn-e",), "compact_model"),
        (("kcf", "dasiamrpn"), "dasiamrpn_model"),
        (("etd",), "compact_model"),
    ],
)
def test_a_model_file_that_cannot_be_used_is_refused_before_the_work(dataset, place, capsys, systems, setting):
    more = ("--set", f"recovery.{setting}=/nowhere/weights.pth")
    assert main(arguments(dataset, *more, systems=systems)) == 2
    error = capsys.readouterr().err
    assert "/nowhere/weights.pth" in error
    assert error.count("\n") == 1
    assert list(place.iterdir()) == []


def test_results_may_lie_in_the_recordings_folder(dataset, tmp_path, capsys, monkeypatch):
    shutil.copytree(dataset / "blind", tmp_path / "blind")
    monkeypatch.chdir(tmp_path / "blind")
    for more in (("--output", "results"), ()):
        for _ in range(2):
            assert main(["evaluate", "--dataset", "folder", ".", "--systems", "etd-nr", *more]) == 0
        assert "1 of 1 cells are done already" in capsys.readouterr().err


def test_an_output_that_cannot_be_written_to_is_refused_before_the_work(dataset, place, capsys):
    assert main(arguments(dataset, "--store", "cells.sqlite", "--output", "/proc")) == 2
    assert "/proc: cannot be written to" in capsys.readouterr().err
    assert list(place.iterdir()) == []


def test_a_file_in_the_place_of_the_output_folder_is_refused_before_the_work(dataset, place, capsys):
    (place / "notes.txt").write_text("mine")
    assert main(arguments(dataset, "--output", "notes.txt")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "notes.txt is no folder" in line
    assert [path.name for path in place.iterdir()] == ["notes.txt"]


def test_results_are_kept_here_where_no_file_is_named(dataset, place, capsys):
    assert main(arguments(dataset, "--only", "blind", systems=("etd-nr",))) == 0
    assert capsys.readouterr().err.splitlines()[0] == "results are kept in evaluation.sqlite"
    assert [path.name for path in place.iterdir()] == ["evaluation.sqlite"]
    assert main(arguments(dataset, "--only", "blind", systems=("etd-nr",))) == 0
    assert "1 of 1 cells are done already" in capsys.readouterr().err


def test_the_same_sequence_twice_is_refused(dataset, capsys):
    assert main(arguments(dataset, "--dataset", "folder", str(dataset))) == 2
    assert "two folders of folder have a sequence blind" in capsys.readouterr().err


def test_options_for_datasets_mean_nothing_without_one(capsys):
    assert main(["evaluate", "--suite", "--store", "cells.sqlite"]) == 2
    assert "--store means nothing with --suite and --random: leave it out, or give --dataset" in capsys.readouterr().err
