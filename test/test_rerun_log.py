"""Logs to the Rerun viewer hold what was tracked, on the time of the data."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from rerun_files import logged

from etd_ros import rerun_log as module
from etd_ros.boxes import Box
from etd_ros.errors import EtdError
from etd_ros.output_files import OutputError
from etd_ros.overlay import ON
from etd_ros.rerun_log import RGB_COLOURS, RerunError, check_rerun, rerun_log
from etd_ros.tracking import TargetReport, TargetState

START_NS = 1_700_000_000_123_456_789
MS = 1_000_000
WIDTH, HEIGHT = 64, 48


def report(name: str, state: TargetState, box: Box | None = None, score: float = 0.0) -> TargetReport:
    return TargetReport(name, state, box, score)


def frame() -> np.ndarray:
    data = np.zeros((HEIGHT, WIDTH, 2), np.uint8)
    data[10, 20, 0] = 255
    return data


def test_boxes_scores_and_nzge_of_every_frame_are_there_with_their_stamps(tmp_path):
    path = tmp_path / "log.rrd"
    stamps = [START_NS + index * 2 * MS for index in range(100)]
    with rerun_log(str(path)) as log:
        for index, stamp_ns in enumerate(stamps):
            ball = report("ball", TargetState.TRACKING, Box(index, 2, 10, 20), 0.5)
            tin = report("tin/a b", TargetState.TRACKING, Box(3, 4, 5, 6), 0.25)
            log.add(stamp_ns, frame(), (ball, tin) if index % 2 else (ball,), nzge=0.001 * index)
    found = logged(path)
    assert [stamp for stamp, _ in found["boxes"]] == stamps
    assert [row["centers"][0][0] for _, row in found["boxes"]] == [index + 5 for index in range(100)]
    assert found["boxes"][3][1]["half_sizes"] == [[5, 10], [2.5, 3]]
    assert [len(row["colors"]) for _, row in found["boxes"][:4]] == [1, 2, 1, 2]
    assert [stamp for stamp, _ in found["nzge"]] == stamps
    assert [row["scalars"][0] for _, row in found["nzge"]] == pytest.approx([0.001 * index for index in range(100)])
    assert [row["scalars"] for _, row in found["scores/ball"]] == [[0.5]] * 100
    (of_tin,) = (rows for entity, rows in found.items() if entity.startswith("scores/tin"))
    assert [stamp for stamp, _ in of_tin] == stamps[1::2]


def test_a_target_without_a_box_has_none_there_either(tmp_path):
    path = tmp_path / "log.rrd"
    with rerun_log(str(path)) as log:
        log.add(START_NS, frame(), (report("ball", TargetState.TRACKING, Box(1, 2, 3, 4), 0.9),))
        log.add(START_NS + MS, frame(), (report("ball", TargetState.LOST),))
    boxes = dict(logged(path)["boxes"])
    assert len(boxes[START_NS]["centers"]) == 1
    assert not boxes[START_NS + MS]["centers"]


def test_boxes_have_the_colour_of_their_state(tmp_path):
    path = tmp_path / "log.rrd"
    with rerun_log(str(path)) as log:
        log.add(START_NS, frame(), (report("ball", TargetState.TRACKING, Box(1, 2, 3, 4), 0.9),))
    red, green, blue = RGB_COLOURS[TargetState.TRACKING]
    assert logged(path)["boxes"][0][1]["colors"] == [(red << 24) + (green << 16) + (blue << 8) + 255]
    assert green > max(red, blue)


def test_changes_of_state_are_told_once(tmp_path):
    path = tmp_path / "log.rrd"
    states = (TargetState.TRACKING, TargetState.TRACKING, TargetState.RECOVERING, TargetState.LOST, TargetState.LOST)
    with rerun_log(str(path)) as log:
        for index, state in enumerate(states):
            log.add(START_NS + index * MS, frame(), (report("ball", state),))
    told = [(stamp, row["level"], row["text"]) for stamp, row in logged(path)["states"]]
    assert told == [
        (START_NS, ["INFO"], ["ball: tracking"]),
        (START_NS + 2 * MS, ["WARN"], ["ball: tracking -> recovering"]),
        (START_NS + 3 * MS, ["ERROR"], ["ball: recovering -> lost"]),
    ]


def test_pictures_come_thirty_times_a_second_and_show_frame_and_image(tmp_path):
    path = tmp_path / "log.rrd"
    image = np.full((HEIGHT, WIDTH), 200, np.uint8)
    with rerun_log(str(path)) as log:
        for index in range(1000):
            log.add(START_NS + index * MS, frame(), (), image)
    found = logged(path)
    assert len(found["events"]) in (30, 31)
    assert [stamp for stamp, _ in found["reconstruction"]] == [stamp for stamp, _ in found["events"]]
    (blob,) = found["events"][-1][1]["blob"]
    events = cv2.imdecode(np.array(blob, np.uint8), cv2.IMREAD_COLOR)
    assert events.shape == (HEIGHT, WIDTH, 3)
    assert tuple(events[10, 20]) == ON
    (blob,) = found["reconstruction"][-1][1]["blob"]
    shown = cv2.imdecode(np.array(blob, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert abs(shown.astype(int) - 200).max() <= 2


def test_time_that_goes_back_is_logged_as_it_comes(tmp_path):
    path = tmp_path / "log.rrd"
    stamps = [START_NS + 100 * MS, START_NS, START_NS + 50 * MS]
    with rerun_log(str(path)) as log:
        for stamp_ns in stamps:
            log.add(stamp_ns, frame(), ())
    assert [stamp for stamp, _ in logged(path)["events"]] == sorted(stamps)


def test_a_file_appears_only_when_all_went_well(tmp_path):
    def fail() -> None:
        with rerun_log(str(tmp_path / "log.rrd")) as log:
            log.add(START_NS, frame(), ())
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert not list(tmp_path.iterdir())


def test_a_disk_that_gets_full_ends_the_log_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "ROOM_MIN_MIB", 2**40)
    with pytest.raises(RerunError, match=r"log\.rrd: less than .* free"), rerun_log(str(tmp_path / "log.rrd")) as log:
        log.add(START_NS, frame(), ())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("destination", "kind", "words"),
    [
        ("log.csv", RerunError, "log.csv: Rerun recordings are .rrd files"),
        ("", RerunError, "Rerun recordings are .rrd files"),
        ("missing/log.rrd", OutputError, "missing/log.rrd: cannot be written"),
        ("http://somewhere:9876", RerunError, "http://somewhere:9876: no address of a Rerun viewer"),
        ("spawn", RerunError, "no display"),
    ],
)
def test_wrong_destinations_are_named(destination, kind, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(kind, match=words) as caught:
        check_rerun(destination)
    assert isinstance(caught.value, EtdError)
    assert "\n" not in str(caught.value)
