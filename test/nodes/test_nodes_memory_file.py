"""What a `memory_file` may be: a damaged one keeps no node from starting, and nothing else is ever overwritten."""

import dataclasses
import shutil
from pathlib import Path

import pytest
from conftest import Bench

from etd_ros.boxes import Box
from etd_ros.nodes.target_memory import TargetMemory
from etd_ros.output_files import OutputError
from etd_ros.tracking import TargetReport, TargetState

TARGETS = "targets:=ball:64.866,34.762,40,40"
STAMP_NS = 1_700_000_000_000_000_000
REPORTS = [TargetReport(name, TargetState.TRACKING, Box(1.0, 2.0, 30.0, 40.0), 0.5) for name in ("ball", "drum")]

CLASSES = {"ball": "", "drum": "person"}


def remembering(path: Path) -> TargetMemory:
    warnings: list[str] = []
    memory = TargetMemory(path, [], warnings.append)
    assert not warnings
    return memory


@pytest.fixture
def written(tmp_path) -> bytes:
    """What a node writes of two targets."""
    path = tmp_path / "written.csv"
    memory = remembering(path)
    for stamp_ns in (STAMP_NS, STAMP_NS + 50_000_000):
        memory.note(stamp_ns, REPORTS, CLASSES.__getitem__)
    memory.save()
    assert {target.name for target in remembering(path).recall(STAMP_NS + 100_000_000)} == {"ball", "drum"}
    content = path.read_bytes()
    path.unlink()
    return content


@pytest.mark.parametrize("state", [TargetState.TRACKING, TargetState.LOST])
def test_what_a_target_is_comes_back_with_it(tmp_path, state):
    path = tmp_path / "memory.csv"
    memory = remembering(path)
    memory.note(STAMP_NS, REPORTS, CLASSES.__getitem__)
    later = [
        dataclasses.replace(report, state=state, box=report.box if state is TargetState.TRACKING else None)
        for report in REPORTS
    ]
    memory.note(STAMP_NS + 50_000_000, later, CLASSES.__getitem__)
    memory.save()
    assert {target.name: target.class_id for target in remembering(path).recall(STAMP_NS + 100_000_000)} == CLASSES


@pytest.mark.parametrize("class_id", ["a,b", 'so "called"'])
def test_a_class_may_hold_what_tables_are_made_of(tmp_path, class_id):
    path = tmp_path / "memory.csv"
    memory = remembering(path)
    memory.note(STAMP_NS, REPORTS, lambda _: class_id)
    memory.save()
    assert {target.class_id for target in remembering(path).recall(STAMP_NS)} == {class_id}


@pytest.mark.parametrize("class_id", ["two\nlines", "\0", "\ud800", "p" * 65])
def test_a_class_that_no_table_can_hold_is_left_out_and_the_boxes_stay(tmp_path, class_id):
    path = tmp_path / "memory.csv"
    memory = remembering(path)
    memory.note(STAMP_NS, REPORTS, lambda _: class_id)
    memory.save()
    assert [(found.name, found.class_id) for found in remembering(path).recall(STAMP_NS)] == [
        ("ball", ""),
        ("drum", ""),
    ]


def test_a_memory_of_before_there_were_classes_is_taken_back(tmp_path):
    path = tmp_path / "memory.csv"
    path.write_text(f"stamp_ns,target,x,y,w,h,score,state\n{STAMP_NS},ball,2.0,3.0,40.0,50.0,1.0,tracking\n")
    (target,) = remembering(path).recall(STAMP_NS)
    assert (target.name, target.box, target.class_id) == ("ball", Box(2, 3, 40, 50), "")


def test_a_memory_that_is_cut_at_any_byte_is_set_aside_with_one_warning(tmp_path, written):
    path = tmp_path / "memory.csv"
    wholes = {end for end in range(len(written) + 1) if end and written[end - 1 : end] == b"\n"}
    for end in set(range(len(written))) - wholes:
        path.write_bytes(written[:end])
        warnings: list[str] = []
        assert TargetMemory(path, [], warnings.append).recall(STAMP_NS) == []
        (warning,) = warnings
        assert str(path) in warning
        aside = path.with_name("memory.csv.damaged")
        assert aside.name in warning
        assert aside.read_bytes() == written[:end]
        assert not path.exists()
        aside.unlink()


@pytest.mark.parametrize("damage", [lambda whole: bytes(len(whole)), lambda whole: whole[:80] + bytes(60) + b"\n"])
def test_zeros_of_a_power_cut_are_set_aside_too_and_earlier_ones_stay(tmp_path, written, damage):
    path = tmp_path / "memory.csv"
    damaged = damage(written)
    for name in ("memory.csv.damaged", "memory.csv.damaged1"):
        path.write_bytes(damaged)
        TargetMemory(path, [], lambda _: None)
        assert (tmp_path / name).read_bytes() == damaged


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"target,stamp_ns,x,y,w,h\nball,1,2,3,4,5\n", "first line"),
        (b"stamp_ns,target,x,y,w,h\n1,ball,2,3,4,5\n", "first line"),
        (b"notes\n", "first line"),
        (b"\x89PNG\r\n\x1a\n", "first line"),
        (b"\0\0PNG", "first line"),
        (
            b"stamp_ns,target,x,y,w,h,score,state\n"
            + b"".join(b"%d,ball,2.0,3.0,4.0,5.0,1.0,tracking\n" % stamp for stamp in range(3)),
            "3 boxes of ball",
        ),
    ],
)
def test_what_no_node_has_written_is_refused_and_left_as_it_is(tmp_path, content, reason):
    path = tmp_path / "notes.csv"
    path.write_bytes(content)
    with pytest.raises(OutputError, match=rf"notes\.csv: .*{reason}.*: name another file"):
        remembering(path)
    assert [(file.name, file.read_bytes()) for file in tmp_path.iterdir()] == [("notes.csv", content)]


def test_a_file_that_is_read_is_refused_by_whatever_name(tmp_path, written):
    (tmp_path / "folder").mkdir()
    path = tmp_path / "boxes.csv"
    path.write_bytes(written)
    (tmp_path / "link.csv").symlink_to(path)
    for spelling in (path, tmp_path / "folder" / ".." / "boxes.csv", tmp_path / "link.csv"):
        with pytest.raises(OutputError, match="targets_file, and memory_file would overwrite it"):
            TargetMemory(spelling, [path], print)
    assert path.read_bytes() == written


def line_of_refusal(bench: Bench, *parameters: str) -> str:
    """The one line that a node ends with."""
    process = bench.start("pipeline", ros=tuple(word for parameter in parameters for word in ("-p", parameter)))
    assert process.wait(timeout=60) == 2
    (line,) = [line for line in bench.log("pipeline").splitlines() if line.startswith("etd_ros:")]
    return line


def test_labelled_boxes_are_never_overwritten(bench, repository, tmp_path):
    boxes = tmp_path / "boxes.csv"
    shutil.copy(repository / "bags" / "demo" / "boxes.csv", boxes)
    before = boxes.read_bytes()
    assert "memory_file would overwrite it" in line_of_refusal(bench, f"targets_file:={boxes}", f"memory_file:={boxes}")
    assert "name another file" in line_of_refusal(bench, TARGETS, f"memory_file:={boxes}")
    assert boxes.read_bytes() == before


@pytest.mark.parametrize("name", ["tracker", "pipeline"])
def test_a_node_starts_with_an_empty_memory_and_says_so(bench, tmp_path, name):
    memory = tmp_path / "memory.csv"
    memory.touch()
    bench.start(name, ros=("-p", TARGETS, "-p", f"memory_file:={memory}"))
    bench.wait_until(lambda: bench.figure(name, "life cycle") == "active", "the node runs")
    assert bench.log(name).count("memory.csv.damaged") == 1
    assert (tmp_path / "memory.csv.damaged").exists()
    assert bench.end(name) == 0
