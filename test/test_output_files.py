"""Outputs appear whole or not at all, and never in the place of something that is no file."""

from __future__ import annotations

import os

import pytest

from etd_ros.output_files import (
    OutputError,
    check_folder,
    check_outputs,
    check_pictures,
    make_folder,
    write_beside,
    written_beside,
)


@pytest.mark.parametrize("content", ["Straße\n", b"\x89PNG\r\n"])
def test_what_is_written_is_read_back(tmp_path, content):
    path = tmp_path / "out"
    path.write_text("from an earlier run")
    write_beside(path, content)
    assert path.read_bytes() == (content if isinstance(content, bytes) else content.encode())
    assert list(tmp_path.iterdir()) == [path]


def test_a_text_appears_only_when_it_is_whole(tmp_path):
    path = tmp_path / "out.csv"
    with written_beside(path) as file:
        file.write("first\n")
        assert not path.exists()
    assert path.read_bytes() == b"first\n"

    def write_and_fail():
        with written_beside(path) as file:
            file.write("second\n")
            raise KeyError

    with pytest.raises(KeyError):
        write_and_fail()
    assert path.read_bytes() == b"first\n"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("place", ["missing/out", "folder", "file/out", "pipe"])
def test_what_cannot_be_written_is_named_and_left_as_it_is(tmp_path, place):
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "pipe")
    before = sorted(tmp_path.rglob("*"))
    path = tmp_path / place
    with pytest.raises(OutputError, match=f"{place}: cannot be written"):
        check_outputs(None, path)
    with pytest.raises(OutputError, match=f"{place}: cannot be written"):
        write_beside(path, b"")
    with pytest.raises(OutputError, match=f"{place}: cannot be written"), written_beside(path):
        pass
    assert sorted(tmp_path.rglob("*")) == before


def test_two_outputs_of_one_name_are_refused(tmp_path):
    (tmp_path / "folder").mkdir()
    check_outputs(tmp_path / "a", tmp_path / "b")
    with pytest.raises(OutputError, match="one name"):
        check_outputs(tmp_path / "a", tmp_path / "folder" / ".." / "a")


def test_an_output_that_is_read_as_well_is_refused(tmp_path):
    boxes = tmp_path / "boxes.csv"
    boxes.write_text("labelled for hours")
    with pytest.raises(OutputError, match="boxes.csv: is read, and would be overwritten"):
        check_outputs(tmp_path / "other.csv", tmp_path / "." / "boxes.csv", inputs=[None, boxes])


@pytest.mark.parametrize("name", ["plot.txt", "plot", "plot.png.txt", ".png"])
def test_a_picture_is_not_written_under_a_name_that_promises_something_else(tmp_path, name):
    check_pictures(None, tmp_path / "plot.png", tmp_path / "PLOT.PNG")
    with pytest.raises(OutputError, match=f"{name}: pictures are PNG files: name it something.png"):
        check_pictures(tmp_path / "plot.png", tmp_path / name)


def test_a_folder_is_made_with_those_above_it_and_may_be_there(tmp_path):
    for _ in range(2):
        make_folder(tmp_path / "above" / "results")
        check_folder(tmp_path / "above" / "results")
    assert list((tmp_path / "above" / "results").iterdir()) == []


@pytest.mark.parametrize("place", ["notes.txt", "notes.txt/results", "notes.txt/above/results"])
def test_a_file_where_a_folder_shall_be_is_named(tmp_path, place):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(OutputError) as refused:
        make_folder(tmp_path / place)
    assert str(refused.value) == (
        f"{tmp_path / place}: cannot be made a folder ({tmp_path / 'notes.txt'} is no folder): "
        "name one that you may write, or a new one"
    )
    assert (tmp_path / "notes.txt").read_text() == "mine"
