"""The store: what is kept comes back, whoever is killed; what is not a store is refused in one line."""

from __future__ import annotations

import csv
import dataclasses
import math
import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from etd_ros.boxes import Box
from etd_ros.evaluation import EvaluationError, TimedBox, TrackRow
from etd_ros.evaluation.cells import Cell, CellResult
from etd_ros.evaluation.fingerprint import PACKAGE, fingerprint, recording_state, source_files
from etd_ros.evaluation.store import Store
from etd_ros.settings import settings_from_mapping

CELL = Cell("ecd", "shapes_6dof", "star", "etd", "one-pass", 0)


def brought(cell: Cell = CELL, **changes) -> CellResult:
    track = [
        TrackRow(5, cell.target, Box(1.5, 2.25, 3.0, 0.1 + 0.2), 0.75, "tracking"),
        TrackRow(7, cell.target, None, math.nan, "lost"),
    ]
    result = CellResult(cell, 0.4, 0.5, [6, 8], [0.8, 0.0], [0.5, math.inf], 0, track, 2, 1000, 0.25)
    return dataclasses.replace(result, **changes)


def failed(cell: Cell = CELL) -> CellResult:
    return CellResult(cell, math.nan, math.nan, [], [], [], 0, [], 0, 0, math.nan, "it broke")


def same(one: CellResult, other: CellResult) -> bool:
    """NaN equals NaN here."""
    return repr(one) == repr(other)


def test_what_is_kept_comes_back_to_the_last_bit_in_a_later_run(tmp_path):
    other = dataclasses.replace(CELL, repetition=1)
    with Store(tmp_path / "cells.sqlite") as store:
        store.add(brought(), "f")
    with Store(tmp_path / "cells.sqlite") as store:
        store.add(failed(other), "f")
    with Store(tmp_path / "cells.sqlite") as store:
        assert store.done() == {(CELL, "f"), (other, "f")}
        assert store.done(with_errors=False) == {(CELL, "f")}
        found = list(store.results([(other, "f"), (CELL, "f"), (CELL, "g")]))
    assert [same(*pair) for pair in zip(found, [failed(other), brought()], strict=True)] == [True, True]


def test_a_cell_done_again_replaces_itself_and_leaves_other_fingerprints(tmp_path):
    with Store(tmp_path / "cells.sqlite") as store:
        store.add(failed(), "f")
        store.add(brought(), "g")
        store.add(brought(ap=0.9), "f")
        assert [result.ap for result in store.results([(CELL, "f"), (CELL, "g")])] == [0.9, 0.4]
        store.export_csv(tmp_path / "cells.csv", [(CELL, "f")])
    with (tmp_path / "cells.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["ap"], row["labels"], row["fingerprint"]) for row in rows] == [("0.9", "2", "f")]


def test_a_process_killed_while_it_writes_leaves_whole_cells(tmp_path):
    """The process is killed between two statements of a transaction, when the cell's row is there and its track not."""
    path = tmp_path / "cells.sqlite"
    with Store(path) as store:
        store.add(brought(), "f")
    program = f"""
import os, signal, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from test_evaluation_store import CELL, brought
from etd_ros.evaluation.store import Store
class Dying(list):
    def __iter__(self):
        os.kill(os.getpid(), signal.SIGKILL)
with Store(__import__("pathlib").Path({str(path)!r})) as store:
    store.add(brought(track=Dying()), "g")
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    killed = subprocess.run([sys.executable, "-c", program], env=environment, check=False)
    assert killed.returncode == -signal.SIGKILL
    with Store(path) as store:
        assert store.done() == {(CELL, "f")}
        store.add(brought(), "g")
        assert [len(result.track) for result in store.results([(CELL, "g")])] == [2]


def test_an_interrupted_write_leaves_the_store_usable(tmp_path):
    class Interrupted(list):
        def __iter__(self):
            raise KeyboardInterrupt

    with Store(tmp_path / "cells.sqlite") as store:
        with pytest.raises(KeyboardInterrupt):
            store.add(brought(track=Interrupted()), "f")
        assert store.done() == set()
        store.add(brought(), "f")
        assert store.done() == {(CELL, "f")}


def other_program(path: Path) -> None:
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE cells (id INTEGER)")
    database.close()


def later_version(path: Path) -> None:
    Store(path).close()
    with sqlite3.connect(path) as database:
        database.execute("PRAGMA user_version = 99")
    database.close()


def damaged(path: Path) -> None:
    with Store(path) as store:
        for repetition in range(50):
            store.add(brought(dataclasses.replace(CELL, repetition=repetition)), "f")
    content = bytearray(path.read_bytes())
    content[4096:] = bytes(len(content) - 4096)
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.write_text("stamp_ns,target\n" * 100), "not a database"),
        (other_program, "another program's database"),
        (later_version, "schema version 99"),
        (damaged, "cannot be used"),
        (lambda path: path.mkdir(), "unable to open"),
    ],
)
def test_what_is_no_store_is_refused_in_one_line(tmp_path, make, message):
    path = tmp_path / "cells.sqlite"
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(EvaluationError, match=message) as caught, Store(path) as store:
        list(store.results([(cell, print_) for cell, print_ in store.done()]))
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert (path.read_bytes() if path.is_file() else None) == before


def test_two_processes_may_write_one_store(tmp_path):
    path = tmp_path / "cells.sqlite"
    with Store(path) as one, Store(path) as two:
        one.add(brought(), "f")
        two.add(brought(), "g")
        assert one.done() == two.done() == {(CELL, "f"), (CELL, "g")}


def test_the_fingerprint_follows_recording_labels_and_settings(tmp_path):
    recording, model = tmp_path / "recording.bag", tmp_path / "model.pth"
    recording.write_bytes(b"events")
    model.write_bytes(b"weights")
    labels = [TimedBox(1, Box(1, 2, 3, 4)), TimedBox(2, Box(1, 2, 3, 4))]

    def now(topic: str | None = None, boxes=labels, **settings) -> str:
        values = {name.replace("__", "."): value for name, value in settings.items()}
        return fingerprint(recording_state(recording, topic), boxes, settings_from_mapping(values))

    first = now()
    assert first == now()
    of_model = now(recovery__compact_model=str(model))
    others = [now("/events"), now(boxes=labels[:1]), now(tracking__failure_iou=0.4), of_model]
    model.write_bytes(b"other weights")
    others.append(now(recovery__compact_model=str(model)))
    recording.write_bytes(b"more events")
    others.append(now())
    assert len({first, *others}) == 7


@pytest.mark.parametrize("container", ["events.txt", "metadata.yaml"])
def test_labels_and_results_in_the_recordings_folder_change_nothing(tmp_path, container):
    (tmp_path / container).write_text("0 1 1 1\n")
    first = recording_state(tmp_path, None)
    (tmp_path / "results").mkdir()
    for name in ("boxes.csv", "boxes.keys.json", "evaluation.sqlite", "tracks.csv", "results/report.html"):
        (tmp_path / name).write_text("new")
    assert recording_state(tmp_path, None) == first
    (tmp_path / ("images.txt" if container == "events.txt" else "bag_0.mcap")).write_text("new")
    assert recording_state(tmp_path, None) != first


def test_the_fingerprint_follows_all_code_that_boxes_come_from():
    names = {file.relative_to(PACKAGE).as_posix() for file in source_files()}
    assert {
        "events.py", "settings.py", "stream.py", "targets.py", "conversion/atsltd.py", "recordings/loaded.py",
        "systems/eco/tracker.py", "tracking/multi_tracker.py", "evaluation/cell_run.py", "evaluation/protocol.py",
        "recovery/weights/compact.safetensors",
    } <= names  # fmt: skip
    assert not {name.split("/")[0] for name in names} & {"nodes", "commands", "labelling", "simulation"}
    assert {name for name in names if name.startswith("evaluation/")} == {
        "evaluation/cell_run.py", "evaluation/protocol.py", "evaluation/scoring.py"
    }  # fmt: skip


@pytest.mark.parametrize("part", ["_sources_digest", "_library_versions"])
def test_the_fingerprint_follows_sources_and_libraries(monkeypatch, part):
    labels = [TimedBox(1, Box(1, 2, 3, 4))]
    before = fingerprint("", labels, settings_from_mapping({}))
    monkeypatch.setattr(f"etd_ros.evaluation.fingerprint.{part}", lambda: "other")
    assert fingerprint("", labels, settings_from_mapping({})) != before


@pytest.mark.parametrize("folder", ["images", "pics"])
@pytest.mark.parametrize("recording", [".", "events.txt"])
def test_a_text_recordings_fingerprint_follows_its_video_frames(tmp_path, recording, folder):
    (tmp_path / folder).mkdir()
    (tmp_path / "events.txt").write_text("0 1 1 1\n")
    states = [recording_state(tmp_path / recording, None)]
    (tmp_path / "images.txt").write_text(f"0.1 {folder}/frame.png\n\nnothing\n")
    states.append(recording_state(tmp_path / recording, None))
    for picture in (b"picture", b"another"):
        (tmp_path / folder / "frame.png").write_bytes(picture)
        states.append(recording_state(tmp_path / recording, None))
    assert len(set(states)) == 4
