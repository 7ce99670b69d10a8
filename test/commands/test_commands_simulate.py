"""The command `simulate`: a bag with its truth."""

import dataclasses

import numpy as np
import pytest

from etd_ros.cli import main
from etd_ros.commands import simulate as command
from etd_ros.evaluation import read_boxes
from etd_ros.evaluation.suite import START_NS as EVALUATED_FROM_NS
from etd_ros.events import Events, concatenate
from etd_ros.recordings import open_recording
from etd_ros.simulation import SUITE, Scene, demo_scene, random_sequences


@pytest.fixture
def short_scene(monkeypatch):
    """The demo's scene, over after 0.2 s."""

    def shortened(seed: int) -> Scene:
        scene = demo_scene(seed)
        return Scene(scene.width, scene.height, 0.2, scene.background, scene.sprites)

    monkeypatch.setitem(command.SCENES, "demo", shortened)


def simulated(output, *options: str) -> bytes:
    assert main(["simulate", "demo", "--output", str(output), *options]) == 0
    with open_recording(output) as recording:
        return b"".join(events.to_structured().tobytes() for events in recording.events())


@pytest.mark.usefixtures("short_scene")
def test_a_seed_repeats_its_recording_and_another_makes_another(tmp_path):
    first, again, other = (
        simulated(tmp_path / name, "--seed", seed) for name, seed in (("a", "3"), ("b", "3"), ("c", "4"))
    )
    assert first == again
    assert first != other


@pytest.mark.usefixtures("short_scene")
def test_the_bag_holds_packets_of_10_ms_and_nothing_else_is_left(tmp_path):
    simulated(tmp_path / "bag")
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
    assert sorted(path.name for path in (tmp_path / "bag").iterdir()) == [
        "absent.csv",
        "bag.mcap",
        "boxes.csv",
        "metadata.yaml",
    ]
    with open_recording(tmp_path / "bag") as recording:
        assert (recording.topic, recording.width, recording.height) == ("/event_camera/events", 240, 180)
        packets = list(recording.packets())
    assert len(packets) == 20
    assert [packet.seq for packet in packets] == list(range(20))
    for number, packet in enumerate(packets):
        start_ns = command.START_NS + number * 10_000_000
        assert start_ns <= packet.events.t[0] <= packet.events.t[-1] < start_ns + 10_000_000


@pytest.mark.usefixtures("short_scene")
def test_the_truth_lies_on_the_events_clock(tmp_path):
    simulated(tmp_path / "bag")
    for labels in read_boxes(tmp_path / "bag" / "boxes.csv").values():
        stamps = [label.stamp_ns for label in labels]
        assert stamps == list(range(command.START_NS + 100_000_000, command.START_NS + 200_000_000, 10_000_000))


@pytest.mark.usefixtures("short_scene")
def test_force_replaces_a_simulated_bag(tmp_path):
    first = simulated(tmp_path / "bag")
    assert main(["simulate", "demo", "--output", str(tmp_path / "bag"), "--seed", "8"]) == 2
    assert simulated(tmp_path / "bag", "--seed", "8", "--force") != first


@pytest.mark.usefixtures("short_scene")
def test_a_failure_keeps_the_older_bag_and_leaves_nothing_else(tmp_path, monkeypatch):
    first = simulated(tmp_path / "bag")

    def no_space(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(command, "write_boxes", no_space)
        assert main(["simulate", "demo", "--output", str(tmp_path / "bag"), "--force"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["bag"]
    with open_recording(tmp_path / "bag") as recording:
        assert b"".join(events.to_structured().tobytes() for events in recording.events()) == first


@pytest.mark.usefixtures("short_scene")
def test_an_interrupt_leaves_nothing(tmp_path, monkeypatch):
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "write_boxes", interrupted)
    assert main(["simulate", "demo", "--output", str(tmp_path / "bag")]) == 130
    assert list(tmp_path.iterdir()) == []


def test_the_list_tells_what_each_sequence_tests(capsys):
    assert main(["simulate", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["demo", *SUITE, "random-SEED"]
    assert all(sequence.description in line for sequence, line in zip(SUITE.values(), lines[1:-1], strict=True))


@pytest.mark.parametrize("seed", [0, 114, 7004])
def test_a_random_sequence_is_event_for_event_what_is_evaluated(tmp_path, seed):
    assert main(["simulate", f"random-{seed}", "--output", str(tmp_path / "bag")]) == 0
    (sequence,) = random_sequences([seed])
    evaluated = concatenate(list(sequence.events(start_ns=EVALUATED_FROM_NS)))
    with open_recording(tmp_path / "bag") as recording:
        made = concatenate(list(recording.events()))
    assert (made.width, made.height) == (sequence.width, sequence.height)
    assert made.to_structured().tobytes() == evaluated.to_structured().tobytes()
    assert set(read_boxes(tmp_path / "bag" / "boxes.csv")) <= set(sequence.scene().targets)


@pytest.mark.parametrize("name", ["moon", "random", "random-", "random-07", "random--1", "random-1x"])
def test_an_unknown_sequence_is_one_line_that_names_what_there_is(tmp_path, capsys, name):
    with pytest.raises(SystemExit, match="2"):
        main(["simulate", name, "--output", str(tmp_path / "bag")])
    (line,) = capsys.readouterr().err.splitlines()
    assert f"no sequence {name!r}: choose one of 'demo', 'ball'" in line
    assert "random-SEED" in line


@pytest.fixture
def short_suite(monkeypatch):
    """Two sequences of the suite: one of 0.2 s, and one in which something leaves."""
    ball = SUITE["ball"]
    short = dataclasses.replace(ball, recipe=dataclasses.replace(ball.recipe, duration_s=0.2))
    monkeypatch.setattr(command, "SUITE", {"ball": short, "exit": SUITE["exit"]})


@pytest.mark.usefixtures("short_suite")
def test_the_whole_suite_goes_into_a_folder_each(tmp_path):
    assert main(["simulate", "suite", "--output", str(tmp_path / "all")]) == 0
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == ["ball", "exit"]
    with open_recording(tmp_path / "all" / "ball") as recording:
        events = b"".join(events.to_structured().tobytes() for events in recording.events())
    made = command.SUITE["ball"].events(start_ns=command.START_NS)
    assert events == b"".join(batch.to_structured().tobytes() for batch in made)


@pytest.mark.usefixtures("short_suite")
def test_absences_lie_on_the_events_clock_beside_the_boxes(tmp_path):
    assert main(["simulate", "exit", "--output", str(tmp_path / "exit")]) == 0
    header, row = (tmp_path / "exit" / "absent.csv").read_text().splitlines()
    assert header == "target,start_ns,end_ns,reason"
    target, start_ns, end_ns, reason = row.split(",")
    assert (target, reason) == ("ball_1", "left")
    assert int(end_ns) == command.START_NS + 2_000_000_000
    labels = read_boxes(tmp_path / "exit" / "boxes.csv")["ball_1"]
    assert labels[-1].stamp_ns < int(start_ns)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["ball"], "no --output"),
        (["suite", "--seed", "1", "--output", "x"], "whose seeds are fixed"),
        (["random-7", "--seed", "1", "--output", "x"], "whose name holds its seed"),
    ],
)
def test_what_cannot_be_simulated_is_refused(capsys, arguments, message):
    assert main(["simulate", *arguments]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("scene", ["demo", "suite"])
def test_a_file_in_the_place_of_a_folder_above_the_bag_is_refused(tmp_path, capsys, scene):
    (tmp_path / "notes.txt").write_text("mine")
    assert main(["simulate", scene, "--output", str(tmp_path / "notes.txt" / "bag")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"({tmp_path / 'notes.txt'} is no folder)" in line


def test_packets_end_on_the_clock_and_hold_all_events():
    t = np.array([0, 3, 9_999_999, 10_000_000, 35_000_000, 36_000_000], np.int64)
    events = Events(t, *(np.zeros(6, np.uint16) for _ in range(2)), np.zeros(6, np.uint8), 8, 8)
    made = list(command.packets([events[:1], events[1:4], events[4:]]))
    assert [packet.t.tolist() for packet in made] == [t[:3].tolist(), t[3:4].tolist(), t[4:].tolist()]
