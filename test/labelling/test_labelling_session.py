import json

import numpy as np
import pytest

from etd_ros.boxes import Box
from etd_ros.errors import EtdError
from etd_ros.evaluation import read_boxes
from etd_ros.evaluation.truth import TimedBox
from etd_ros.labelling import LabellingError, LabelSession
from etd_ros.output_files import OutputError

STAMPS = 1_700_000_000_000_000_000 + 10_000_000 * np.arange(20)
BOX = [10, 10, 20, 20]


@pytest.fixture
def output(tmp_path):
    return tmp_path / "boxes.csv"


def begun(output):
    return LabelSession(STAMPS, 240, 180, output)


def edit(session, action, **content):
    return session.edit({"action": action, **content})


def target(state, name="ball"):
    return next(found for found in state["targets"] if found["name"] == name)


def test_two_key_frames_make_a_box_on_each_picture_between(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    state = edit(session, "box", target="ball", picture=4, box=[20, 10, 20, 30])
    assert target(state)["keys"] == [{"at": 2, "box": Box(*BOX)}, {"at": 4, "box": Box(20, 10, 20, 30)}]
    assert target(state)["boxes"] == [None, None, BOX, [15, 10, 20, 25], [20, 10, 20, 30], *[None] * 15]


def test_saving_writes_a_row_for_each_picture_between_key_frames(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    edit(session, "box", target="ball", picture=4, box=[20, 10, 20, 30])
    edit(session, "add", target="still without a box")
    assert not session.is_saved
    state = session.save()
    assert state["notice"] == "3 boxes of 1 target saved"
    assert session.is_saved
    assert read_boxes(output) == {
        "ball": [
            TimedBox(int(STAMPS[2]), Box(10, 10, 20, 20)),
            TimedBox(int(STAMPS[3]), Box(15, 10, 20, 25)),
            TimedBox(int(STAMPS[4]), Box(20, 10, 20, 30)),
        ]
    }


def test_a_target_at_one_time_is_saved_with_a_word_of_warning(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    assert "ball: label at two times or more" in session.save()["notice"]


def test_nothing_to_save_is_said_and_writes_nothing(output):
    session = begun(output)
    with pytest.raises(LabellingError, match="draw one first"):
        session.save()
    assert not output.exists()


def test_each_change_is_kept_so_that_another_session_goes_on(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    edit(session, "hide", target="ball", picture=7)
    again = begun(output)
    assert again.state()["targets"] == session.state()["targets"]
    assert not again.is_saved


def test_what_was_saved_goes_on_with_its_key_frames_and_not_with_every_row(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    edit(session, "box", target="ball", picture=9, box=BOX)
    session.save()
    again = begun(output)
    assert again.is_saved
    assert [key["at"] for key in target(again.state())["keys"]] == [2, 9]


def test_a_csv_without_kept_key_frames_is_loaded(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    edit(session, "box", target="ball", picture=9, box=[20, 10, 20, 30])
    session.save()
    session.keys_path.unlink()
    assert begun(output).state()["targets"] == session.state()["targets"]


def test_what_targets_are_is_kept_saved_and_read_again(output):
    output.write_text(
        "target,stamp_ns,x,y,w,h,class\n"
        + "".join(f"anna,{STAMPS[picture]},10,10,20,20,person\n" for picture in (2, 3))
        + "".join(f"ball,{STAMPS[picture]},50,10,20,20,\n" for picture in (2, 3))
    )
    session = begun(output)
    assert {found["name"]: found["class"] for found in session.state()["targets"]} == {"anna": "person", "ball": ""}
    edit(session, "class", target="ball", to=" toy ")
    edit(session, "box", target="ball", picture=4, box=BOX)
    edit(session, "rename", target="anna", to="bea")
    assert begun(output).state()["targets"] == session.state()["targets"]
    session.save()
    classes = {name: [row.class_id for row in rows] for name, rows in read_boxes(output).items()}
    assert classes == {"bea": ["person"] * 2, "ball": ["toy"] * 3}
    session.keys_path.unlink()
    assert {found["name"]: found["class"] for found in begun(output).state()["targets"]} == {
        "bea": "person",
        "ball": "toy",
    }


def test_a_class_is_taken_away_and_comes_back_by_undo(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    edit(session, "class", target="ball", to="toy")
    assert target(edit(session, "class", target="ball", to=""))["class"] == ""
    assert target(edit(session, "undo"))["class"] == "toy"


def test_without_a_class_the_csv_has_no_column_for_it(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    session.save()
    assert output.read_text().startswith("target,stamp_ns,x,y,w,h\n")


@pytest.mark.parametrize("class_id", ["two\nlines", "p" * 65])
def test_a_class_that_cannot_be_printed_is_refused(output, class_id):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    with pytest.raises(LabellingError, match="at most 64 printable characters"):
        edit(session, "class", target="ball", to=class_id)
    assert target(session.state())["class"] == ""


@pytest.mark.parametrize("name", ["", "two\nlines", "ball, red", "p" * 65])
def test_a_name_that_tracking_would_refuse_is_refused(output, name):
    session = begun(output)
    with pytest.raises(LabellingError, match="without commas"):
        edit(session, "box", target=name, picture=2, box=BOX)
    assert session.state()["targets"] == []


def test_kept_key_frames_of_before_there_were_classes_go_on(output):
    targets = [{"name": "a", "key_frames": [[int(STAMPS[2]), [1, 2, 3, 4]]]}]
    kept = {"is_saved": False, "csv_digest": None, "targets": targets}
    begun(output).keys_path.write_text(json.dumps(kept))
    state = begun(output).state()
    assert target(state, "a")["class"] == ""
    assert target(state, "a")["boxes"][2] == [1, 2, 3, 4]


def test_a_csv_changed_by_somebody_else_is_what_goes_on(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    edit(session, "box", target="ball", picture=9, box=BOX)
    session.save()
    output.write_text(output.read_text().replace("ball", "drone"))
    assert [found["name"] for found in begun(output).state()["targets"]] == ["drone"]


def test_a_csv_changed_beside_work_that_is_not_saved_is_not_decided_upon(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    edit(session, "box", target="ball", picture=9, box=BOX)
    session.save()
    edit(session, "hide", target="ball", picture=12)
    output.write_text(output.read_text().replace("ball", "drone"))
    with pytest.raises(LabellingError, match=r"changed since boxes.keys.json was kept.*remove the one"):
        begun(output)


@pytest.mark.parametrize(
    "content",
    [
        "",
        "{",
        "[]",
        '{"is_saved": true, "csv_digest": null, "targets": [{"name": "", "key_frames": []}]}',
        '{"is_saved": true, "csv_digest": null, "targets": [{"name": "a", "key_frames": [[5, null], [5, null]]}]}',
        '{"is_saved": true, "csv_digest": null, "targets": [{"name": "a", "key_frames": [[5, [1, 2, 3]]]}]}',
        '{"is_saved": true, "csv_digest": null, "targets": [{"name": "a", "key_frames": [[-5, null]]}]}',
        "[" * 100_000,
    ],
)
def test_damaged_key_frames_are_refused_in_one_line(output, content):
    output.with_suffix(".keys.json").write_text(content)
    with pytest.raises(LabellingError, match=r"boxes.keys.json: holds no key frames") as refused:
        begun(output)
    assert "\n" not in str(refused.value)


def test_a_csv_that_is_gone_takes_no_key_frame_with_it(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    session.save()
    output.unlink()
    again = begun(output)
    assert again.state()["targets"] == session.state()["targets"]
    assert not again.is_saved


def test_a_csv_changed_while_somebody_draws_is_not_decided_upon_either(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    session.save()
    output.write_text(output.read_text().replace("ball", "drone"))
    edit(session, "hide", target="ball", picture=12)
    with pytest.raises(LabellingError, match="changed since"):
        begun(output)


def test_a_change_that_cannot_be_kept_is_not_made(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    before = session.state()
    session.keys_path.unlink()
    session.keys_path.mkdir()
    with pytest.raises(OutputError):
        edit(session, "hide", target="ball", picture=12)
    with pytest.raises(OutputError):
        edit(session, "undo")
    assert session.state() == before


def test_changes_are_undone_and_done_again(output):
    session = begun(output)
    states = [session.state()["targets"]]
    for change in (
        {"action": "box", "target": "ball", "picture": 2, "box": BOX},
        {"action": "box", "target": "ball", "picture": 5, "box": BOX},
        {"action": "clear", "target": "ball", "key": 0},
        {"action": "rename", "target": "ball", "to": "drone"},
        {"action": "hide", "target": "drone", "picture": 9},
        {"action": "delete", "target": "drone"},
    ):
        states.append(session.edit(change)["targets"])
    assert states[-1] == []
    for expected in reversed(states[:-1]):
        assert edit(session, "undo")["targets"] == expected
    for expected in states[1:]:
        assert edit(session, "redo")["targets"] == expected
    with pytest.raises(LabellingError, match="there is nothing to redo"):
        edit(session, "redo")


def test_a_change_after_undo_forgets_what_was_undone(output):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    edit(session, "undo")
    assert not edit(session, "add", target="drone")["can_redo"]


def test_a_change_that_changes_nothing_needs_no_undoing(output):
    session = begun(output)
    edit(session, "add", target="ball")
    session.edit({"action": "add", "target": "ball"})
    assert edit(session, "undo")["targets"] == []


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"action": "explode", "target": "ball"},
        {"action": "hide", "target": "nobody", "picture": 1},
        {"action": "hide", "target": "ball", "picture": 20},
        {"action": "hide", "target": "ball", "picture": -1},
        {"action": "hide", "target": "ball", "picture": "1"},
        {"action": "clear", "target": "ball", "key": 5},
        {"action": "clear", "target": "ball"},
        {"action": "add", "target": "  "},
        {"action": "add", "target": "x" * 65},
        {"action": "add", "target": "a\nb"},
        {"action": "rename", "target": "ball", "to": "other"},
        {"action": "box", "target": "ball", "picture": 1, "box": [1, 2, 3]},
        {"action": "box", "target": "ball", "picture": 1, "box": [1, 2, 3, "4"]},
        {"action": "box", "target": "ball", "picture": 1, "box": "1234"},
        {"action": "box", "target": "ball", "picture": 1, "box": [1, 2, 0, 4]},
        {"action": "box", "target": "ball", "picture": 1, "box": [1, 2, float("nan"), 4]},
        {"action": "box", "target": "ball", "picture": 1, "box": [240, 2, 5, 4]},
    ],
)
def test_a_change_that_makes_no_sense_is_refused_and_changes_nothing(output, change):
    session = begun(output)
    edit(session, "box", target="ball", picture=2, box=BOX)
    edit(session, "add", target="other")
    before, kept = session.state(), json.loads(session.keys_path.read_text())
    with pytest.raises(EtdError):
        session.edit(change)
    assert session.state() == before
    assert json.loads(session.keys_path.read_text()) == kept


def test_key_frames_between_pictures_are_shown_where_they_lie(output):
    output.write_text(f"target,stamp_ns,x,y,w,h\nball,{STAMPS[3] + 2_500_000},1,1,9,9\nball,{STAMPS[8]},5,1,9,9\n")
    state = begun(output).state()
    assert [key["at"] for key in target(state)["keys"]] == [3.25, 8]
    assert [box is not None for box in target(state)["boxes"]] == [*[False] * 4, *[True] * 5, *[False] * 11]
