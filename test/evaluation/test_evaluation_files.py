"""BOXES.csv and TRACKS.csv: round trips, and errors that name the line."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.boxes import Box
from etd_ros.evaluation import EvaluationError, TimedBox, TrackRow, TracksWriter, read_boxes, read_tracks, write_boxes
from etd_ros.output_files import OutputError

HEADER = "target,stamp_ns,x,y,w,h\n"

numbers = st.floats(-1e6, 1e6)
sizes = st.floats(1e-3, 1e6)
boxes = st.builds(Box, numbers, numbers, sizes, sizes)
rows = st.builds(
    TrackRow,
    stamp_ns=st.integers(0, 2**63 - 1),
    target=st.sampled_from(["car", "a b", 'quoted "name"', "comma,name", "ünïcode"]),
    box=st.none() | boxes,
    score=numbers,
    state=st.sampled_from(["idle", "tracking", "recovering", "lost"]),
)


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "boxes.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_boxes_are_read_by_target_in_order_of_time(tmp_path):
    path = write(tmp_path, HEADER + "b,30,1,2,3,4\na,10,5,6,7,8\nb,20,9,8,7,6.5\n")
    assert read_boxes(path) == {
        "b": [TimedBox(20, Box(9, 8, 7, 6.5)), TimedBox(30, Box(1, 2, 3, 4))],
        "a": [TimedBox(10, Box(5, 6, 7, 8))],
    }
    assert list(read_boxes(path)) == ["b", "a"]


def test_a_byte_order_mark_blank_lines_and_windows_line_ends_are_passed_over(tmp_path):
    path = write(tmp_path, "\ufeff" + HEADER.replace("\n", "\r\n") + "\r\n  ,\r\na,10,5,6,7,8\r\n\r\n")
    assert read_boxes(path) == {"a": [TimedBox(10, Box(5, 6, 7, 8))]}


def test_columns_may_come_in_another_order_and_others_may_be_there(tmp_path):
    path = write(tmp_path, "stamp_ns,note,h,w,y,x,target\n10,hello,4,3,2,1,a\n")
    assert read_boxes(path) == {"a": [TimedBox(10, Box(1, 2, 3, 4))]}


@pytest.mark.parametrize(
    ("text", "line", "complaint"),
    [
        ("target,stamp_ns,x,y,w\na,1,1,1,1\n", 1, "lacks the column h"),
        ("target,stamp_ns,x,y,w,h,x\n", 1, "names a column twice"),
        (HEADER + "a,1,1,1,1,1\na,2,1,1,1\n", 3, "has 5 cells, not 6"),
        (HEADER + "a,1,1,1,1,1,1\n", 2, "has 7 cells, not 6"),
        (HEADER + "\n\n ,1,1,1,1,1\n", 4, "has no name"),
        (HEADER + "a,1.5,1,1,1,1\n", 2, "stamp_ns '1.5' is not a whole number"),
        (HEADER + "a,-1,1,1,1,1\n", 2, "stamp_ns -1 is out of range"),
        (HEADER + f"a,{2**63},1,1,1,1\n", 2, "is out of range"),
        (HEADER + "a,1,left,1,1,1\n", 2, "x 'left' is not a number"),
        (HEADER + "a,1,1,,1,1\n", 2, "y '' is not a number"),
        (HEADER + "a,1,1,1,nan,1\n", 2, "w is nan"),
        (HEADER + "a,1,1,inf,1,1\n", 2, "y is inf"),
        (HEADER + "a,1,1,1,0,1\n", 2, "has no area"),
        (HEADER + "a,1,1,1,1,-4\n", 2, "has no area"),
        (HEADER + 'a,1,1,1,1,"4\n', 2, "is not CSV"),
        (HEADER + "a,1,1,1,1,4\nb,1,2,1,1,4\na,1,2,1,1,4\n", 4, "another line has 'a' at 1 ns, too: keep one"),
    ],
)
def test_a_wrong_line_is_named_with_file_and_number(tmp_path, text, line, complaint):
    path = write(tmp_path, text)
    with pytest.raises(EvaluationError) as caught:
        read_boxes(path)
    assert str(caught.value).startswith(f"{path}, line {line}: ")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("text", "complaint"), [("", "is empty"), ("\n\n", "is empty"), (HEADER, "holds no box")])
def test_a_file_without_boxes_is_refused(tmp_path, text, complaint):
    with pytest.raises(EvaluationError, match=complaint):
        read_boxes(write(tmp_path, text))


def test_what_is_no_text_file_is_refused(tmp_path):
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00\x80")
    for path in (tmp_path / "missing.csv", tmp_path, binary):
        with pytest.raises(EvaluationError, match="cannot be read"):
            read_boxes(path)


@settings(deadline=None, max_examples=50)
@given(boxes=st.lists(boxes, min_size=1, max_size=5))
def test_written_boxes_are_read_back_to_a_thousandth_of_a_pixel(tmp_path_factory, boxes):
    path = tmp_path_factory.mktemp("boxes") / "boxes.csv"
    write_boxes(path, {"a": [TimedBox(stamp_ns, box) for stamp_ns, box in enumerate(boxes)]})
    for written, read in zip(boxes, read_boxes(path)["a"], strict=True):
        assert read.box == pytest.approx(written, abs=5.01e-4)


@settings(deadline=None, max_examples=50)
@given(rows=st.lists(rows, max_size=12))
def test_written_tracks_are_read_back_unchanged(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("tracks") / "tracks.csv"
    with TracksWriter(path) as writer:
        for row in rows:
            writer.write(row)
    expected: dict[str, list[TrackRow]] = {}
    for row in sorted(rows, key=lambda row: row.stamp_ns):
        expected.setdefault(row.target, []).append(row)
    assert read_tracks(path) == expected


def test_tracks_without_score_and_state_are_read(tmp_path):
    path = write(tmp_path, "stamp_ns,target,x,y,w,h\n1,a,1,2,3,4\n2,a,,,,\n")
    first, second = read_tracks(path)["a"]
    assert (first.box, second.box, first.state) == (Box(1, 2, 3, 4), None, "")
    assert math.isnan(first.score)


def test_a_wrong_line_of_a_track_file_is_named(tmp_path):
    path = write(tmp_path, "stamp_ns,target,x,y,w,h,score,state\n1,a,1,2,3,4,high,tracking\n")
    with pytest.raises(EvaluationError, match="line 2: score 'high' is not a number"):
        read_tracks(path)


def test_nothing_is_left_of_tracks_that_were_not_finished(tmp_path):
    path = tmp_path / "tracks.csv"
    path.write_text("from an earlier run")

    def fail_while_writing() -> None:
        with TracksWriter(path) as writer:
            writer.write(TrackRow(1, "a", None, 0.0, "lost"))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail_while_writing()
    assert [file.name for file in tmp_path.iterdir()] == ["tracks.csv"]
    assert path.read_text() == "from an earlier run"


@pytest.mark.parametrize("place", ["missing/tracks.csv", "folder", "file/tracks.csv"])
def test_an_output_that_cannot_be_written_is_refused_and_leaves_nothing(tmp_path, place):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(OutputError, match="cannot be written"), TracksWriter(tmp_path / place):
        pass
    assert sorted(tmp_path.rglob("*")) == before
