import pytest
from dataset_writers import (
    ROS_EPOCH_NS,
    image_stamps,
    moving_events,
    write_csv,
    write_ros1_bag,
    write_text_folder,
)

from etd_ros.boxes import Box
from etd_ros.datasets import DATASETS, DatasetError, open_dataset
from etd_ros.errors import EtdError
from etd_ros.evaluation.truth import TimedBox
from etd_ros.recordings import open_recording


def two_labels(start_ns=0, target="ball"):
    return [(target, start_ns + 10**8, 10, 20, 30, 40), (target, start_ns + 10**9, 15, 25, 30, 40)]


def found(name, path, **options):
    return {sequence.name: sequence for sequence in open_dataset(name, path, **options)}


def test_ecd_text_folders_and_bags_are_sequences_with_the_boxes_beside_them(tmp_path):
    write_text_folder(tmp_path / "shapes_6dof", moving_events(0))
    write_csv(tmp_path / "shapes_6dof" / "boxes.csv", two_labels())
    write_ros1_bag(tmp_path / "poster_6dof.bag", moving_events(ROS_EPOCH_NS))
    write_csv(tmp_path / "poster_6dof.boxes.csv", two_labels(ROS_EPOCH_NS, "poster"))
    sequences = found("ecd", tmp_path)
    assert list(sequences) == ["poster_6dof", "shapes_6dof"]
    assert sequences["shapes_6dof"].recording == tmp_path / "shapes_6dof"
    assert sequences["poster_6dof"].recording == tmp_path / "poster_6dof.bag"
    assert {sequence.dataset for sequence in sequences.values()} == {"ecd"}
    assert sequences["poster_6dof"].boxes == {
        "poster": [
            TimedBox(ROS_EPOCH_NS + 10**8, Box(10, 20, 30, 40)),
            TimedBox(ROS_EPOCH_NS + 10**9, Box(15, 25, 30, 40)),
        ]
    }


def test_what_cannot_be_read_is_passed_over_and_named_unless_it_is_asked_for(tmp_path):
    for name in ("good", "few", "cut"):
        write_text_folder(tmp_path / name, moving_events(0))
        write_csv(tmp_path / name / "boxes.csv", two_labels()[: 1 if name == "few" else 2])
    (tmp_path / "cut" / "events.txt").write_bytes(b"0.1 1 1 1\n\0\0")
    lines: list[str] = []
    assert list(found("folder", tmp_path, tell=lines.append)) == ["good"]
    assert [line.split(" is passed over: ")[0] for line in lines] == ["cut", "few"]
    assert list(found("folder", tmp_path, only=["good"])) == ["good"]
    for name in ("few", "cut"):
        with pytest.raises(EtdError, match=name):
            open_dataset("folder", tmp_path, only=["good", name])


@pytest.mark.parametrize(("start_ns", "taken"), [(0, "shapes"), (ROS_EPOCH_NS, "shapes.bag")])
def test_of_a_bag_and_a_text_folder_of_one_name_the_one_on_the_clock_of_the_labels_is_taken(tmp_path, start_ns, taken):
    write_text_folder(tmp_path / "shapes", moving_events(0))
    write_ros1_bag(tmp_path / "shapes.bag", moving_events(ROS_EPOCH_NS))
    write_csv(tmp_path / "shapes.boxes.csv", two_labels(start_ns))
    (sequence,) = open_dataset("ecd", tmp_path)
    assert (sequence.name, sequence.recording) == ("shapes", tmp_path / taken)


@pytest.mark.parametrize("start_ns", [0, ROS_EPOCH_NS])
def test_labels_are_on_the_clock_on_which_the_recording_gives_its_events(tmp_path, start_ns):
    events = moving_events(start_ns)
    recording = write_ros1_bag(tmp_path / "a.bag", events) if start_ns else write_text_folder(tmp_path / "a", events)
    write_csv(tmp_path / "a.boxes.csv", two_labels(start_ns))
    (sequence,) = open_dataset("ecd", tmp_path)
    with open_recording(sequence.recording) as opened:
        times = [int(t) for batch in opened.events() for t in batch.t]
    assert sequence.recording == recording
    assert all(times[0] <= label.stamp_ns <= times[-1] for label in sequence.boxes["ball"])


@pytest.mark.parametrize("folder", ["", "dynamic"])
def test_ecd_is_labelled_by_files_of_single_objects_too(tmp_path, folder):
    write_text_folder(tmp_path / "dynamic", moving_events(0))
    write_text_folder(tmp_path / "dynamic_6dof", moving_events(0))
    lines = ["10000 1 21 22 37", "20000 3 21 22 37", "30000 190 20 0 0", "40000 9 21 22 37"]
    for name in ("dynamic_HEAD.txt", "dynamic_CUP.txt", "dynamic_6dof_CUP2.txt"):
        (tmp_path / folder / name).write_text("\n".join(lines))
    (sequence, *others) = open_dataset("ecd", tmp_path)
    assert [other.name for other in others] == ([] if folder else ["dynamic_6dof"])
    assert sequence.recording == tmp_path / "dynamic"
    assert sorted(sequence.boxes) == ["cup", "head"]
    assert sequence.boxes["head"] == [
        TimedBox(stamp_ns, Box(x, 21, 22, 37)) for stamp_ns, x in ((10**7, 1), (2 * 10**7, 3), (4 * 10**7, 9))
    ]


def test_labels_on_another_clock_are_refused(tmp_path):
    write_text_folder(tmp_path / "shapes", moving_events(0))
    write_csv(tmp_path / "shapes" / "boxes.csv", two_labels(ROS_EPOCH_NS))
    with pytest.raises(DatasetError, match=r"boxes.csv: its labels, .* are not on the clock of .*shapes \(0 to 2"):
        open_dataset("ecd", tmp_path)


def test_sequences_without_labels_are_named_in_one_line_with_the_command_that_makes_them(tmp_path):
    write_text_folder(tmp_path / "shapes", moving_events(0))
    write_csv(tmp_path / "shapes" / "boxes.csv", two_labels())
    for name in ("boxes", "dynamic"):
        write_ros1_bag(tmp_path / f"{name}.bag", moving_events(ROS_EPOCH_NS))
    told = []
    assert list(found("ecd", tmp_path, tell=told.append)) == ["shapes"]
    assert told == [
        "without labels: boxes, dynamic; make them with "
        f"`python -m etd_ros label {tmp_path}/boxes.bag --output {tmp_path}/boxes.boxes.csv`"
    ]


def test_archives_that_are_not_unpacked_are_named(tmp_path):
    (tmp_path / "shapes_6dof.zip").write_bytes(b"PK")
    with pytest.raises(DatasetError, match=r"no labelled sequence: not unpacked: shapes_6dof.zip; unzip"):
        open_dataset("ecd", tmp_path)
    write_text_folder(tmp_path / "shapes_6dof", moving_events(0))
    with pytest.raises(DatasetError) as refused:
        open_dataset("ecd", tmp_path)
    assert "shapes_6dof.zip" not in str(refused.value)


def test_a_long_text_is_not_read_but_for_its_ends(tmp_path):
    folder = write_text_folder(tmp_path / "shapes", moving_events(0, count=60_000))
    lines = (folder / "events.txt").read_text().splitlines()
    lines[30_000] = "what the disk left of this line"
    (folder / "events.txt").write_text("\n".join(lines))
    write_csv(folder / "boxes.csv", two_labels())
    assert list(found("ecd", tmp_path)) == ["shapes"]


def test_a_folder_that_is_itself_a_sequence_is_the_only_one(tmp_path, monkeypatch):
    folder = write_text_folder(tmp_path / "shapes", moving_events(0))
    write_csv(folder / "boxes.csv", two_labels())
    assert list(found("folder", folder)) == ["shapes"]
    monkeypatch.chdir(folder)
    assert list(found("folder", ".")) == ["shapes"]


def test_real_recordings_in_folders_are_sequences_and_those_without_labels_are_passed_over(data):
    sequences = found("folder", data)
    assert {name: sorted(sequence.boxes) for name, sequence in sequences.items()} == {
        "slider_depth": ["dark_ball", "dartboard", "leather_ball", "tennis_ball"],
        "traffic": ["silver_car"],
    }


def test_the_same_recording_in_two_containers_is_one_sequence_and_the_bag_is_read(data):
    (traffic,) = open_dataset("folder", data / "traffic")
    with open_recording(traffic.recording) as recording:
        assert recording.kind == "ROS 2 bag"


def test_a_container_that_is_not_needed_need_not_be_readable(tmp_path):
    write_ros1_bag(tmp_path / "a.bag", moving_events(ROS_EPOCH_NS))
    (tmp_path / "a.aedat4").write_bytes(b"what the disk left of it")
    write_csv(tmp_path / "a.boxes.csv", two_labels(ROS_EPOCH_NS))
    (sequence,) = open_dataset("folder", tmp_path)
    assert sequence.recording == tmp_path / "a.bag"


def test_sequences_take_as_many_folder_names_as_tell_them_apart(tmp_path):
    root = tmp_path / "IROS_Dataset"
    places = ["fast_drone", "light_variations/strobe", "multiple_objects/1_obj", "multiple_objects/2_objs"]
    for place in places:
        folder = write_text_folder(root / place, moving_events(0))
        write_csv(folder / "boxes.csv", two_labels())
    expected = ["fast_drone", "light_variations", "multiple_objects-1_obj", "multiple_objects-2_objs"]
    assert list(found("folder", tmp_path)) == expected
    assert list(found("folder", root)) == expected


def test_one_boxes_csv_beside_several_recordings_belongs_to_none(tmp_path):
    for name in ("a", "b"):
        write_ros1_bag(tmp_path / f"{name}.bag", moving_events(ROS_EPOCH_NS))
    write_csv(tmp_path / "boxes.csv", two_labels(ROS_EPOCH_NS))
    with pytest.raises(DatasetError, match="no labelled sequence: without labels: a, b"):
        open_dataset("folder", tmp_path)


def test_two_label_files_of_one_sequence_are_refused(tmp_path):
    folder = write_text_folder(tmp_path / "a", moving_events(0))
    write_csv(folder / "boxes.csv", two_labels())
    write_csv(tmp_path / "a.boxes.csv", two_labels())
    with pytest.raises(DatasetError, match=r"a.boxes.csv and .*boxes.csv label the same sequence: remove one"):
        open_dataset("folder", tmp_path)


def test_folders_that_link_to_each_other_end(tmp_path):
    folder = write_text_folder(tmp_path / "a" / "b", moving_events(0))
    write_csv(folder / "boxes.csv", two_labels())
    (tmp_path / "a" / "again").symlink_to(tmp_path)
    assert list(found("folder", tmp_path)) == ["a"]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (two_labels()[:1], "'ball' has a single label"),
        ([*two_labels(), two_labels()[1]], "two labels of 'ball' at 1000000000 ns"),
        ([*two_labels(), ("ball", 10**9 + 1, 500, 20, 30, 40)], "lies off the 190x180 sensor"),
        ([*two_labels(), ("ball", 10**9 + 1, "nan", 20, 30, 40)], "line 4: x is nan"),
    ],
)
def test_labels_that_cannot_be_scored_are_refused(tmp_path, rows, message):
    folder = write_text_folder(tmp_path / "a", moving_events(0), [0])
    write_csv(folder / "boxes.csv", rows)
    with pytest.raises(EtdError, match=message):
        open_dataset("folder", tmp_path)


def test_what_cannot_be_opened_is_said_in_one_line(tmp_path):
    recording = write_ros1_bag(tmp_path / "a.bag", moving_events(ROS_EPOCH_NS), image_stamps(moving_events(0), 2))
    for name, path, message in [
        ("nuscenes", tmp_path, "choose one of ecd, eed, folder"),
        ("ecd", tmp_path / "missing", "no such folder"),
        ("ecd", recording, "is a file: name the folder"),
    ]:
        with pytest.raises(DatasetError, match=message) as refused:
            open_dataset(name, path)
        assert "\n" not in str(refused.value)
    with pytest.raises(DatasetError, match="leave it out for ecd"):
        open_dataset("ecd", tmp_path, box_columns="t x y w h")


def test_a_text_that_ends_in_the_middle_of_a_line_is_refused(tmp_path):
    folder = write_text_folder(tmp_path / "a", moving_events(0))
    with (folder / "events.txt").open("a") as file:
        file.write("2.0x")
    write_csv(folder / "boxes.csv", two_labels())
    with pytest.raises(DatasetError, match=r"events.txt: its last line \('2.0x'\)"):
        open_dataset("folder", tmp_path)


def test_every_dataset_has_words_for_the_help():
    assert list(DATASETS) == ["ecd", "eed", "folder"]
    assert all(DATASETS.values())
