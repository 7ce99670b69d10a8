"""The bundled recording is what its command makes."""

from collections import Counter

import pytest

from etd_ros.cli import main
from etd_ros.evaluation import read_boxes
from etd_ros.recordings import open_recording


def event_counts(bag) -> Counter:
    counts: Counter = Counter()
    with open_recording(bag) as recording:
        for events in recording.events():
            counts.update(zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True))
    return counts


def test_the_bundled_recording_and_its_truth_are_what_the_command_makes(repository, tmp_path):
    bundled, made = repository / "bags" / "demo", tmp_path / "demo"
    assert main(["simulate", "demo", "--output", str(made)]) == 0
    there, here = event_counts(bundled), event_counts(made)
    # Another processor or another library of mathematics may round a time to the next microsecond.
    assert (there & here).total() >= 0.999 * max(there.total(), here.total())
    assert there.total() > 100_000
    for name, labels in read_boxes(bundled / "boxes.csv").items():
        again = read_boxes(made / "boxes.csv")[name]
        assert [label.stamp_ns for label in again] == [label.stamp_ns for label in labels]
        for label, other in zip(labels, again, strict=True):
            assert tuple(other.box) == pytest.approx(tuple(label.box), abs=0.0015)
    assert read_boxes(made / "boxes.csv").keys() == read_boxes(bundled / "boxes.csv").keys()
