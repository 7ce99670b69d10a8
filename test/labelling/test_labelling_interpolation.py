import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.boxes import Box
from etd_ros.evaluation.truth import TimedBox
from etd_ros.labelling.interpolation import boxes_at, key_frames_from, labels_from
from etd_ros.labelling.key_frames import KeyFrame

STEP_NS = 40_000_000
EPOCH_NS = 1_468_939_800_000_000_000
STAMPS = EPOCH_NS + STEP_NS * np.arange(30)

pixels = st.integers(0, 200_000).map(lambda value: value / 1000)
sizes = st.integers(1000, 100_000).map(lambda value: value / 1000)
boxes = st.builds(Box, pixels, pixels, sizes, sizes)


def key(picture, box):
    return KeyFrame(int(STAMPS[picture]), box)


def as_written(labels):
    """Labels as BOXES.csv keeps them."""
    return [TimedBox(label.stamp_ns, Box(*(round(value, 3) for value in label.box))) for label in labels]


def test_between_key_frames_boxes_are_linear_in_time():
    keys = [key(2, Box(10, 20, 30, 40)), key(6, Box(50, 60, 10, 20))]
    labels = labels_from(keys, STAMPS)
    assert [label.stamp_ns for label in labels] == STAMPS[2:7].tolist()
    assert [tuple(label.box) for label in labels] == [
        (10, 20, 30, 40),
        (20, 30, 25, 35),
        (30, 40, 20, 30),
        (40, 50, 15, 25),
        (50, 60, 10, 20),
    ]


def test_uneven_pictures_get_the_box_of_their_own_time():
    stamps = np.array([0, 10, 90, 100], np.int64)
    found = boxes_at([KeyFrame(0, Box(0, 0, 10, 10)), KeyFrame(100, Box(100, 0, 10, 10))], stamps)
    assert found[:, 0].tolist() == [0, 10, 90, 100]


def test_there_is_no_label_while_a_target_cannot_be_seen():
    box = Box(1, 2, 3, 4)
    keys = [key(1, box), key(4, box), key(5, None), key(9, box), key(11, box), key(13, None), key(20, box)]
    assert [label.stamp_ns for label in labels_from(keys, STAMPS)] == STAMPS[[1, 2, 3, 4, 9, 10, 11, 20]].tolist()


def test_a_key_frame_between_pictures_is_a_label_of_its_own():
    keys = [KeyFrame(int(STAMPS[0]) + 5, Box(1, 1, 1, 1)), key(1, Box(1, 1, 1, 1))]
    assert [label.stamp_ns for label in labels_from(keys, STAMPS)] == [STAMPS[0] + 5, STAMPS[1]]


def test_no_key_frames_make_no_labels():
    assert labels_from([], STAMPS) == []
    assert labels_from([key(3, None)], STAMPS) == []


def interpolated_by_hand(keys, stamp_ns):
    """The rule, word by word, in exact fractions."""
    from fractions import Fraction

    for known in keys:
        if known.stamp_ns == stamp_ns:
            return known.box
    before = max((known for known in keys if known.stamp_ns < stamp_ns), key=lambda known: known.stamp_ns, default=None)
    after = min((known for known in keys if known.stamp_ns > stamp_ns), key=lambda known: known.stamp_ns, default=None)
    if before is None or after is None or before.box is None or after.box is None:
        return None
    share = Fraction(stamp_ns - before.stamp_ns, after.stamp_ns - before.stamp_ns)
    return tuple(
        float(Fraction(one) + share * (Fraction(two) - Fraction(one)))
        for one, two in zip(before.box, after.box, strict=True)
    )


key_lists = st.dictionaries(st.integers(0, 29), st.one_of(boxes, boxes, st.none()), max_size=12).map(
    lambda chosen: [key(picture, chosen[picture]) for picture in sorted(chosen)]
)


@settings(deadline=None)
@given(key_lists)
def test_interpolation_follows_the_rule_at_every_picture(keys):
    found = boxes_at(keys, STAMPS)
    for stamp_ns, box in zip(STAMPS.tolist(), found, strict=True):
        expected = interpolated_by_hand(keys, stamp_ns)
        if expected is None:
            assert np.isnan(box).all()
        else:
            assert box == pytest.approx(expected, abs=1e-9)


@settings(deadline=None)
@given(key_lists.filter(lambda keys: sum(known.box is not None for known in keys) > 1))
def test_labels_without_gaps_give_key_frames_from_which_they_follow(keys):
    keys = [known for known in keys if known.box is not None]
    labels = as_written(labels_from(keys, STAMPS))
    recovered = key_frames_from(labels, STAMPS)
    again = labels_from(recovered, STAMPS)
    assert [label.stamp_ns for label in again] == [label.stamp_ns for label in labels]
    assert np.allclose([label.box for label in again], [label.box for label in labels], atol=0.00111)


def test_few_key_frames_are_recovered_with_the_stretches_that_cannot_be_seen():
    keys = [
        key(1, Box(0, 0, 10, 10)),
        key(8, Box(70, 35, 10, 10)),
        key(12, Box(70, 35, 20, 10)),
        key(13, None),
        key(20, Box(5, 5, 5, 5)),
        key(29, Box(50, 5, 5, 5)),
    ]
    assert key_frames_from(as_written(labels_from(keys, STAMPS)), STAMPS) == tuple(keys)


def test_labels_at_other_times_than_the_pictures_have_no_gaps_for_that():
    labels = [TimedBox(int(STAMPS[0]) + 5 + number * 3 * STEP_NS, Box(number, 0, 9, 9)) for number in range(9)]
    assert key_frames_from(labels, STAMPS) == (
        KeyFrame(labels[0].stamp_ns, labels[0].box),
        KeyFrame(labels[-1].stamp_ns, labels[-1].box),
    )


def test_a_single_label_is_a_single_key_frame():
    assert key_frames_from([TimedBox(7, Box(1, 2, 3, 4))], STAMPS) == (KeyFrame(7, Box(1, 2, 3, 4)),)
