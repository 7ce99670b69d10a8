from pathlib import Path

import pytest
from dataset_writers import ROS_EPOCH_NS, image_stamps, moving_events, write_csv, write_ros1_bag, write_text_folder
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from etd_ros.boxes import Box
from etd_ros.datasets import DatasetError, open_dataset
from etd_ros.datasets.box_columns import read_columns
from etd_ros.datasets.box_text import BoxText, read_box_text
from etd_ros.datasets.spans import Span
from etd_ros.evaluation.truth import TimedBox

SPAN = Span(Path("events.txt"), 0, 2 * 10**9, 190, 180)
FRAMES = 21
STAMPS = [number * 10**8 for number in range(FRAMES)]


def ball(number):
    """A ball's box, (x, y, w, h), that moves to the right and down and becomes a little larger."""
    return 60.0 + 5 * number, 30.0 + 3 * number, 20.0 + number % 2, 18.0


def line(layout, number, box, separator=" "):
    x, y, w, h = box
    values = {
        "t": f"{STAMPS[number] / 1e9:.6f}",
        "t_us": str(STAMPS[number] // 1000),
        "t_ns": str(STAMPS[number]),
        "frame0": str(number),
        "frame1": str(number + 1),
        "id": "3",
        "-": str(number),
        **dict(zip("xywh", (x, y, w, h), strict=True)),
        "x1": x,
        "y1": y,
        "x2": x + w,
        "y2": y + h,
        "cx": x + w / 2,
        "cy": y + h / 2,
    }
    return separator.join(str(values[word]) for word in layout.split())


def read(lines, columns=None, stamps=STAMPS, span=SPAN):
    rows = [text.replace(",", " ").split() for text in lines]
    text = BoxText(Path("boundingbox.txt"), len(rows[0]), range(1, len(rows) + 1), rows)
    return read_columns(text, span, lambda: stamps, columns)


def labels_or_refusal(read_labels):
    try:
        return read_labels(), ""
    except DatasetError as err:
        return {}, str(err)


def expected(name="object", numbers=range(FRAMES)):
    return {name: [TimedBox(STAMPS[number], Box(*ball(number))) for number in numbers]}


@pytest.mark.parametrize(
    "layout",
    [
        "t x1 y1 x2 y2",
        "t x2 y2 x1 y1",
        "t x1 y2 x2 y1",
        "t x y w h",
        "t_us x1 y1 x2 y2",
        "t_ns x y w h",
        "frame0 x1 y1 x2 y2",
        "frame0 x y w h",
        "frame1 x1 y1 x2 y2",
        "- t x1 y1 x2 y2",
        "- t x y w h",
    ],
)
def test_the_columns_are_found_from_the_numbers(layout):
    assert read([line(layout, number, ball(number)) for number in range(FRAMES)]) == expected()


@pytest.mark.parametrize("layout", ["t id x1 y1 x2 y2", "t x1 y1 x2 y2 id", "t id x y w h", "- t id x1 y1 x2 y2"])
def test_a_column_that_numbers_the_objects_names_them(layout):
    assert read([line(layout, number, ball(number)) for number in range(FRAMES)]) == expected("object_3")


@pytest.mark.parametrize(
    ("layout", "unseen"),
    [
        ("t x1 y1 x2 y2", "0.5 0 0 0 0"),
        ("t x1 y1 x2 y2", "0.5 9 7 9 8"),
        ("t x y w h", "0.5 0 0 0 0"),
        ("t x y w h", "0.5 190 40 0 0"),
    ],
)
def test_a_box_without_area_says_that_the_object_cannot_be_seen(layout, unseen):
    lines = [line(layout, number, ball(number)) for number in range(FRAMES)]
    lines[5] = unseen
    assert read(lines) == expected(numbers=[number for number in range(FRAMES) if number != 5])


def test_columns_that_can_be_read_in_two_ways_must_be_named():
    lines = [f"{stamp_ns / 1e9} 20 30 60 50" for stamp_ns in STAMPS]
    with pytest.raises(DatasetError, match=r"'t x1 y1 x2 y2' and 't x y w h' fit equally well.*--box-columns"):
        read(lines)
    assert read(lines, "t x1 y1 x2 y2")["object"][0].box == Box(20, 30, 40, 20)
    assert read(lines, "t x y w h")["object"][0].box == Box(20, 30, 60, 50)


def test_frames_counted_from_an_unknown_number_must_be_named():
    lines = [line("frame0 x1 y1 x2 y2", number, ball(number)) for number in range(12, 15)]
    with pytest.raises(DatasetError, match="'frame0 x1 y1 x2 y2' and 'frame1 x1 y1 x2 y2' fit equally well"):
        read(lines)
    assert [label.stamp_ns for label in read(lines, "frame1 x1 y1 x2 y2")["object"]] == STAMPS[11:14]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["900.0 1 1 20 20", "901.0 1 1 20 20"], r"its times \(900.0 to 901.0\) are not those of labels within events"),
        (["0.1 1 1 200 20", "0.2 1 1 200 20"], "line 1 reaches over the border of the 190x180 frame"),
        (
            ["0.1 0.3 0.4 0.5 0.6", "0.2 0.3 0.4 0.5 0.6"],
            r"line 1 has a box of 0.2 x 0.2 pixels; .* 0.5 x 0.6 pixels; no",
        ),
        (["0.1 0 0 0 0"], "holds no box"),
        (["1 2 3"], "3 columns; no other reading"),
    ],
)
def test_numbers_that_make_no_sense_are_refused_with_the_reason(lines, message):
    with pytest.raises(DatasetError, match=message):
        read(lines)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ("t x1 y1 x2 z2", "unknown word 'z2'"),
        ("t x1 y1 x2", "does not say time and box once each"),
        ("t frame0 x y w h", "does not say time and box once each"),
        ("t - x y w h", "5 columns do not fit 't - x y w h'"),
        ("t t x y w h", "does not say time and box once each"),
    ],
)
def test_named_columns_are_checked(columns, message):
    with pytest.raises(DatasetError, match=message):
        read(["0.1 1 1 20 20"], columns)


@settings(deadline=None)
@given(
    numbers=st.lists(st.integers(0, FRAMES - 1), min_size=4, max_size=FRAMES, unique=True).map(sorted),
    start=st.tuples(st.floats(70, 90), st.floats(70, 90)),
    size=st.tuples(st.integers(5, 30), st.integers(5, 30)),
    step=st.floats(1, 3),
    layout=st.sampled_from(["t x1 y1 x2 y2", "t x2 y2 x1 y1", "t x y w h"]),
)
def test_boxes_of_a_moving_object_are_read_back_or_called_ambiguous(numbers, start, size, step, layout):
    boxes = {number: (start[0] + step * number, start[1] + step * number, *map(float, size)) for number in numbers}
    lines = [line(layout, number, boxes[number]) for number in numbers]
    labels, refusal = labels_or_refusal(lambda: read(lines))
    if refusal:
        assert "fit equally well" in refusal
        return
    labels = labels["object"]
    assert [label.stamp_ns for label in labels] == [STAMPS[number] for number in numbers]
    assert [tuple(label.box) for label in labels] == [pytest.approx(boxes[number]) for number in numbers]


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=st.one_of(st.binary(max_size=200), st.text("0123456789.-+eEinfa, \t\n#", max_size=200)))
def test_any_content_is_read_or_refused_in_one_line(tmp_path, content):
    path = tmp_path / "boundingbox.txt"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    boxes, refusal = labels_or_refusal(lambda: read_columns(read_box_text(path), SPAN, lambda: STAMPS))
    if refusal:
        assert str(path) in refusal
        assert "\n" not in refusal
    for labels in boxes.values():
        assert all(SPAN.holds(label.stamp_ns) and min(label.box[2:]) >= 1 for label in labels)


@pytest.mark.parametrize("separator", [" ", ",", "\t", ", ", ";"])
def test_separators_comments_blank_lines_and_a_heading_are_taken(tmp_path, separator):
    rows = ["0.1", "10", "20", "30", "40"], ["0.2", "11", "21", "31", "41"]
    text = "# by hand\ntime x1 y1 x2 y2\n" + "\n\n".join(separator.join(row) for row in rows) + "\r\n"
    (tmp_path / "boundingbox.txt").write_text(text)
    read_text = read_box_text(tmp_path / "boundingbox.txt")
    assert [list(row) for row in read_text.rows] == [list(row) for row in rows]
    assert list(read_text.lines) == [3, 5]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("0.1 1 1 2 2\n0.2 1 1 2\n", "line 2: 4 numbers, not 5 as before"),
        ("0.1 1 1 2 2\n0.2 1 1 2 x\n", "line 2: 'x' is no finite number"),
        ("0.1 1 1 2 inf\n", "line 1: 'inf' is no finite number"),
        ("", "holds no box"),
    ],
)
def test_a_wrong_line_is_named(tmp_path, content, message):
    (tmp_path / "boundingbox.txt").write_text(content)
    with pytest.raises(DatasetError, match=f"boundingbox.txt.*{message}"):
        read_box_text(tmp_path / "boundingbox.txt")


def test_a_file_too_large_for_boxes_is_refused_unread(tmp_path):
    with (tmp_path / "boundingbox.txt").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(DatasetError, match="1099511627776 bytes are too many"):
        read_box_text(tmp_path / "boundingbox.txt")


@pytest.mark.parametrize("layout", ["t x1 y1 x2 y2", "frame0 x1 y1 x2 y2"])
def test_eed_text_folders_are_opened_with_their_boundingbox_txt(tmp_path, layout):
    events = moving_events(0)
    folder = write_text_folder(tmp_path / "IROS" / "fast_drone", events, image_stamps(events, FRAMES))
    lines = [line(layout, number, ball(number)) for number in range(FRAMES)]
    (folder / "boundingbox.txt").write_text("\n".join(lines))
    (sequence,) = open_dataset("eed", tmp_path / "IROS")
    assert (sequence.name, sequence.recording) == ("fast_drone", folder)
    assert sequence.boxes == expected()


def test_eed_bags_are_opened_with_their_boundingbox_txt_on_ros_time(tmp_path):
    events = moving_events(ROS_EPOCH_NS)
    bag = write_ros1_bag(tmp_path / "occlusions" / "occlusions.bag", events, image_stamps(events, 3))
    lines = [f"{(ROS_EPOCH_NS + stamp_ns) / 1e9:.1f} 60 30 {80 + number} 50" for number, stamp_ns in enumerate(STAMPS)]
    (bag.parent / "boundingbox.txt").write_text("\n".join(lines))
    (sequence,) = open_dataset("eed", tmp_path)
    assert (sequence.name, sequence.recording) == ("occlusions", bag)
    assert [label.stamp_ns for label in sequence.boxes["object"]] == [ROS_EPOCH_NS + stamp_ns for stamp_ns in STAMPS]


def test_labels_that_fit_the_text_of_a_sequence_and_not_its_bag_are_read_with_the_text(tmp_path):
    folder = write_text_folder(tmp_path / "occlusions", moving_events(0))
    write_ros1_bag(folder / "occlusions.bag", moving_events(ROS_EPOCH_NS))
    lines = [line("t x1 y1 x2 y2", number, ball(number)) for number in range(FRAMES)]
    (folder / "boundingbox.txt").write_text("\n".join(lines))
    (sequence,) = open_dataset("eed", tmp_path)
    assert sequence.recording == folder


def test_named_columns_reach_eed(tmp_path):
    folder = write_text_folder(tmp_path / "fast_drone", moving_events(0), [0])
    (folder / "boundingbox.txt").write_text("0.1 20 30 60 50\n0.2 20 30 60 50\n")
    with pytest.raises(DatasetError, match="fit equally well"):
        open_dataset("eed", tmp_path)
    (sequence,) = open_dataset("eed", tmp_path, box_columns="t x y w h")
    assert sequence.boxes["object"][0].box == Box(20, 30, 60, 50)


def test_several_objects_without_a_column_that_names_them_are_passed_over_and_named(tmp_path):
    for name in ("fast_drone", "two_objects"):
        folder = write_text_folder(tmp_path / name, moving_events(0), [0])
        lines = [line("t x1 y1 x2 y2", number, ball(number)) for number in range(FRAMES)]
        (folder / "boundingbox.txt").write_text("\n".join(lines))
    write_ros1_bag(folder / "two_objects.bag", moving_events(ROS_EPOCH_NS))
    with (folder / "boundingbox.txt").open("a") as file:
        file.write(f"\n{lines[0]}\n")
    told = []
    assert [sequence.name for sequence in open_dataset("eed", tmp_path, tell=told.append)] == ["fast_drone"]
    read_as, passed_over = told
    assert "fast_drone/boundingbox.txt: read as 't x1 y1 x2 y2'" in read_as
    assert "two_objects is passed over" in passed_over
    assert "which object is which" in passed_over


def test_a_boxes_csv_takes_the_place_of_boundingbox_txt(tmp_path):
    folder = write_text_folder(tmp_path / "fast_drone", moving_events(0), [0])
    (folder / "boundingbox.txt").write_text("nonsense")
    write_csv(folder / "boxes.csv", [("drone", 0, 1, 1, 5, 5), ("drone", 10**8, 1, 1, 5, 5)])
    (sequence,) = open_dataset("eed", tmp_path)
    assert list(sequence.boxes) == ["drone"]


def test_centres_are_read_where_they_are_named():
    lines = [line("t cx cy w h", number, ball(number)) for number in range(FRAMES)]
    assert read(lines, "t cx cy w h") == expected()


def test_the_reading_that_was_found_is_told(tmp_path):
    path = tmp_path / "boundingbox.txt"
    path.write_text("\n".join(line("t x y w h", number, ball(number)) for number in range(FRAMES)))
    said: list[str] = []
    read_columns(read_box_text(path), SPAN, lambda: STAMPS, None, said.append)
    read_columns(read_box_text(path), SPAN, lambda: STAMPS, "t x y w h", said.append)
    assert said == [f"{path}: read as 't x y w h'; if that is wrong, name the columns with --box-columns"]
