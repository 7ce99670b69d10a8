"""Tracks against the truth: scores, a plot, and files that do not belong together."""

from __future__ import annotations

from pathlib import Path

import pytest

from etd_ros.boxes import Box
from etd_ros.cli import main
from etd_ros.evaluation import TimedBox, TrackRow, TracksWriter, write_boxes

BOX, ELSEWHERE = Box(1.0, 2.0, 30.0, 40.0), Box(101.0, 2.0, 30.0, 40.0)


def files(folder: Path, tracked: str, labelled: str, labelled_from_ns: int, box: Box = BOX) -> list[str]:
    """Tracks from 1000 ns to 1400 ns, and labels, of the same box if nothing else is said, for as long."""
    with TracksWriter(folder / "tracks.csv") as tracks:
        for stamp_ns in range(1000, 1500, 100):
            tracks.write(TrackRow(stamp_ns, tracked, BOX, 1.0, "tracking"))
    labels = [TimedBox(stamp_ns, box) for stamp_ns in range(labelled_from_ns, labelled_from_ns + 500, 100)]
    write_boxes(folder / "boxes.csv", {labelled: labels})
    return [str(folder / "tracks.csv"), str(folder / "boxes.csv"), "--output", str(folder / "plot.png")]


@pytest.mark.parametrize("labelled_from_ns", [600, 1000, 1400])
def test_the_scores_are_printed_and_the_plot_is_there(capsys, place, labelled_from_ns):
    assert main(["plot", *files(place, "ball", "ball", labelled_from_ns)]) == 0
    assert capsys.readouterr().out.startswith("ball: AP ")
    assert (place / "plot.png").read_bytes().startswith(b"\x89PNG")


def test_tracks_of_other_names_are_held_against_the_boxes_that_they_overlap(capsys, place):
    assert main(["plot", *files(place, "auto_1", "ball", 1000)]) == 0
    assert capsys.readouterr().out == "ball (auto_1): AP 1.000, AR 1.000 at 4 labelled times\n"
    assert (place / "plot.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(("labelled_from_ns", "box"), [(1000, ELSEWHERE), (500, BOX), (1401, ELSEWHERE)])
def test_boxes_that_no_track_names_or_overlaps_are_refused(capsys, place, labelled_from_ns, box):
    assert main(["plot", *files(place, "auto_1", "ball", labelled_from_ns, box)]) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    for word in ("tracks.csv", "boxes.csv", "name no target in common (auto_1; ball), and no boxes of theirs overlap"):
        assert word in line
    assert captured.out == ""
    assert not (place / "plot.png").exists()


@pytest.mark.parametrize(
    ("labelled", "labelled_from_ns", "words"),
    [
        ("ball", 500, ("have no time in common (ball from 1000 ns, and from 500 ns)", "the same clock")),
        ("ball", 1401, ("have no time in common (ball from 1000 ns, and from 1401 ns)", "the same clock")),
    ],
)
def test_boxes_of_another_recording_are_no_score_of_0(capsys, place, labelled, labelled_from_ns, words):
    assert main(["plot", *files(place, "ball", labelled, labelled_from_ns)]) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    for word in ("tracks.csv", "boxes.csv", *words):
        assert word in line
    assert captured.out == ""
    assert not (place / "plot.png").exists()


def test_a_plot_that_is_named_as_no_png_is_refused_before_anything_is_read(capsys, place):
    assert main(["plot", "no_tracks.csv", "no_boxes.csv", "--output", "plot.pdf"]) == 2
    assert capsys.readouterr().err == "etd_ros: plot.pdf: pictures are PNG files: name it something.png\n"
    assert list(place.iterdir()) == []
