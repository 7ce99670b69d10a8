"""Area and aspect score of proposals (paper Sec. 3.3)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.boxes import Box
from etd_ros.detection import admissibility

sizes = st.floats(0.5, 2000)
places = st.floats(-2000, 2000)
boxes = st.builds(Box, places, places, sizes, sizes)


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        (Box(0, 0, 40, 20), 1.0),
        (Box(99, -5, 40, 20), 1.0),  # only the size counts
        (Box(0, 0, 80, 40), 1 / 4),  # area 4 times, same aspect
        (Box(0, 0, 20, 10), 1 / 4),
        (Box(0, 0, 20, 40), 1 / 4),  # same area, aspect 2 -> 1/2
        (Box(0, 0, 40, 25), 0.8 * 0.8),
        (Box(0, 0, 32, 25), 0.64),  # same area, aspect 2 -> 1.28
    ],
)
def test_hand_values(box, expected):
    assert admissibility(np.array([box]), Box(3, 4, 40, 20)) == pytest.approx([expected])


@settings(deadline=None, max_examples=100)
@given(st.lists(boxes, max_size=5), boxes)
def test_score_lies_above_0_and_at_most_at_1(proposals, last):
    scores = admissibility(np.array(proposals, float).reshape(-1, 4), last)
    assert scores.shape == (len(proposals),)
    assert (scores > 0).all()
    assert (scores <= 1 + 1e-12).all()


@settings(deadline=None, max_examples=100)
@given(boxes)
def test_a_box_of_the_same_size_scores_1(box):
    assert admissibility(np.array([box]), box)[0] == pytest.approx(1.0)


@settings(deadline=None, max_examples=100)
@given(boxes, boxes)
def test_growing_and_shrinking_are_judged_alike(a, b):
    assert admissibility(np.array([a]), b)[0] == pytest.approx(admissibility(np.array([b]), a)[0])
