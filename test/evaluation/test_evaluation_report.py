"""The report: one page with nothing outside it, plots, and pictures of what went wrong."""

from __future__ import annotations

import base64
import dataclasses
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest
from evaluation_sequences import tasks_of, write_sequence

from etd_ros.boxes import Box
from etd_ros.evaluation import TimedBox, TrackRow
from etd_ros.evaluation.cell_run import Workplace, run_cell
from etd_ros.evaluation.cells import Cell, CellResult
from etd_ros.evaluation.failures import (
    ANSWER_COLOUR,
    LABEL_COLOUR,
    Failure,
    drawn,
    failure_pictures,
    labels_before_answer,
    longest_failures,
    seen_at,
)
from etd_ros.evaluation.outputs import write_comparison
from etd_ros.evaluation.plots import plots_of
from etd_ros.evaluation.report import report_html
from etd_ros.evaluation.tables import make_table
from etd_ros.recordings import open_recording
from etd_ros.settings import Settings

SYSTEMS = ("etd-nr", "kcf", "kcf-reconstruction")


@pytest.fixture(scope="module")
def tasks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sequences")
    sequences = [write_sequence(folder, "square"), write_sequence(folder, "<blind>", video=False)]
    return tasks_of(*sequences, systems=SYSTEMS, protocols=("one-pass", "restarts"))


@pytest.fixture(scope="module")
def results(tasks):
    workplace = Workplace()
    return [run_cell(task, workplace) for task in tasks]


class Page(HTMLParser):
    """What a page refers to, and which tags it leaves open."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in ("src", "href", "action", "data")]
        if tag not in ("img", "meta"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def decoded(source: str) -> np.ndarray:
    data = base64.b64decode(source.partition(",")[2])
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)


def test_the_report_is_one_page_that_needs_nothing_beside_it(tasks, results, tmp_path):
    write_comparison(tmp_path, tasks, results, ("one-pass", "restarts"), SYSTEMS)
    text = (tmp_path / "report.html").read_text()
    page = Page(text)
    assert page.open == []
    assert all(re.match(r"data:image/(png|jpeg);base64,", source) for source in page.sources)
    assert "http" not in re.sub(r'src="data:[^"]*"', "", text)
    assert "url(" not in text
    assert "&lt;blind&gt;" in text
    assert "<blind>" not in text
    pictures = [decoded(source) for source in page.sources]
    assert len(pictures) >= 8
    assert all(len(np.unique(picture)) > 10 for picture in pictures)
    assert re.search(r"<h4>etd-nr</h4>.*?(square|&lt;blind&gt;)/square: \d\.\d\d s", text, re.DOTALL)
    assert "needs video" in text
    names = {path.name for path in tmp_path.iterdir()}
    assert {"curves_one-pass.png", "speed_accuracy_restarts.png", "overlap_folder_square_one-pass.png"} <= names


def test_curves_are_over_the_sequences_that_any_system_has_a_result_of(results):
    """KCF has none of the one without video."""
    chosen = [result for result in results if result.cell.protocol == "one-pass"]
    alone = [result for result in chosen if result.cell.system == "kcf"]
    plots = [list(plots_of(make_table(chosen, "one-pass", systems), chosen)) for systems in (SYSTEMS, ("kcf",))]
    assert [plot.name for plot in plots_of(make_table(alone, "one-pass", ("kcf",)), alone)] == [
        "curves", "speed_accuracy", "overlap_folder_square"
    ]  # fmt: skip
    assert list(make_table(chosen, "one-pass", SYSTEMS).means) == ["etd-nr", "kcf-reconstruction"]
    assert plots[0][0].png != plots[1][0].png


def test_names_are_drawn_as_they_are(results):
    """A dollar sign begins a formula in Matplotlib."""
    chosen = [result for result in results if result.cell.protocol == "one-pass"]
    odd = [dataclasses.replace(result, cell=dataclasses.replace(result.cell, target="$x_$")) for result in chosen]
    assert len(list(plots_of(make_table(odd, "one-pass", SYSTEMS), odd))) == 4


def with_overlaps(*overlaps: float, answered_ns: int = 0, target: str = "square") -> CellResult:
    cell = Cell("folder", "square", target, "kcf", "one-pass", 0)
    count = len(overlaps)
    stamps_ns = [10**9 * (number + 1) for number in range(count)]
    track = [TrackRow(answered_ns, target, Box(1, 1, 5, 5), 1.0, "tracking")]
    return CellResult(cell, 0.5, 0.5, stamps_ns, overlaps, [0.0] * count, 0, track, count, 1, 1.0)


def test_the_longest_failure_is_the_longest_run_below_one_half():
    first = with_overlaps(0.1, 0.9, 0.49, 0.0, 0.2, 0.5, 0.1, 0.1)
    (failure,) = longest_failures([with_overlaps(0.4, 0.4, 0.9), first], 2)
    assert (failure.result, failure.first, failure.last, failure.duration_s) == (first, 2, 4, 2.0)
    assert longest_failures([with_overlaps(0.5, 1.0)], 2) == []
    assert longest_failures([], 2) == []


def test_each_failure_shown_is_of_another_target():
    long = with_overlaps(0.1, 0.1, 0.1, 0.9, 0.1, 0.1, target="a")
    short, shorter = with_overlaps(0.9, 0.1, 0.1, target="b"), with_overlaps(0.9, 0.9, 0.1, target="c")
    results = [shorter, long, short]
    assert [failure.result for failure in longest_failures(results, 2)] == [long, short]
    assert [failure.result for failure in longest_failures(results, 9)] == [long, short, shorter]


def test_labels_before_the_first_answer_are_no_failure_of_the_system():
    late = with_overlaps(0.0, 0.0, 0.0, 0.9, 0.1, answered_ns=3_500_000_000)
    (failure,) = longest_failures([late], 1)
    assert (failure.first, failure.last, labels_before_answer(late)) == (4, 4, 3)
    silent = dataclasses.replace(late, track=[])
    assert (longest_failures([silent], 1), labels_before_answer(silent)) == ([], 5)


def test_failures_are_shown_for_each_protocol_and_those_without_said_to_have_none(tasks, results):
    text = report_html(tasks, results, ("one-pass", "restarts"), (*SYSTEMS, "tld"))
    one_pass, again = text.split("<h2>")[1:]
    for part in (one_pass, again):
        assert part.count("<h3>Failures</h3>") == 1
        assert re.search(r"<h4>etd-nr</h4>.*?<figure>", part, re.DOTALL)
        assert "<h4>tld</h4><p>Without a result.</p>" in part


def test_a_system_without_failures_is_said_to_have_none_and_what_it_missed_before_it_answered(tasks):
    good = with_overlaps(0.0, 0.0, 0.9, answered_ns=2_500_000_000)
    text = report_html(tasks, [good], ("one-pass",), ("kcf",))
    assert (
        "<h4>kcf</h4><p>From its first answer on no overlap is below 0.5. Missed before its first answer: 2 labels.</p>"
    ) in text


def test_what_a_video_system_saw_is_the_last_frame_at_or_before_the_time(tasks):
    recording = Workplace().recording(tasks[0].recording, None)
    with open_recording(tasks[0].recording) as opened:
        frames = {image.stamp_ns: image.data for image in opened.images()}
    assert np.array_equal(seen_at(recording, "kcf", 200_000_000, Settings()), frames[200_000_000])
    assert np.array_equal(seen_at(recording, "kcf", 224_999_999, Settings()), frames[200_000_000])


def test_events_are_seen_as_frames_and_reconstructions_as_pictures(tasks):
    recording = Workplace().recording(tasks[0].recording, None)
    frame = seen_at(recording, "etd-plus", 300_000_000, Settings())
    assert (frame.shape, frame.any()) == ((80, 100, 2), True)
    assert seen_at(recording, "kcf-reconstruction", 300_000_000, Settings()).shape == (80, 100)
    assert seen_at(recording, "kcf-reconstruction", 1_000, Settings()) is None


@pytest.mark.parametrize("shape", [(40, 60), (40, 60, 2), (40, 60, 3)])
def test_labels_are_drawn_green_and_answers_red(shape):
    picture = drawn(np.zeros(shape, np.uint8), Box(10, 10, 20, 10), Box(30, 20, 10, 10))
    scale = picture.shape[1] / 60
    assert tuple(picture[round(10 * scale), round(20 * scale)]) == LABEL_COLOUR
    assert tuple(picture[round(30 * scale), round(35 * scale)]) == ANSWER_COLOUR
    assert ANSWER_COLOUR not in {tuple(pixel) for pixel in drawn(np.zeros(shape, np.uint8), Box(1, 1, 5, 5), None)[9]}


def test_a_box_far_off_the_picture_does_no_harm():
    picture = drawn(np.zeros((40, 60), np.uint8), Box(1, 1, 5, 5), Box(-1e9, -1e9, 1e12, 1e12))
    assert picture.shape[1] == 420


def test_a_failure_long_after_the_last_event_has_no_picture(tasks):
    late = TimedBox(60 * 10**9, Box(1, 1, 5, 5))
    task = dataclasses.replace(tasks[0], labels=(*tasks[0].labels, late))
    result = run_cell(task, Workplace())
    failure = Failure(result, len(result.overlaps) - 1, len(result.overlaps) - 1)
    assert failure_pictures(failure, task, Workplace()) == []
