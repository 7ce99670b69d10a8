"""When a look at a target is due."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_ros.tracking.look_pace import (
    EVENTS_MIN,
    FAST_SIZES_PER_S,
    WAIT_MAX_S,
    WAIT_MIN_PX,
    WAIT_MIN_S,
    LookPace,
)

SLOW, FAST = 1.0, 2 * FAST_SIZES_PER_S


def is_due(*, elapsed_s, speed_px_s=10.0, sizes_per_s=SLOW, events=10 * EVENTS_MIN, is_sure=True, patience=1.0):
    pace = LookPace(2.0, 0.1)
    pace.wait_with(events)
    return pace.is_due(elapsed_s, speed_px_s, sizes_per_s, is_sure=is_sure, patience=patience)


def test_a_look_is_due_after_a_time_or_so_much_motion_whichever_comes_first():
    assert not is_due(elapsed_s=0.9 * WAIT_MIN_S)
    assert is_due(elapsed_s=WAIT_MIN_S)
    assert is_due(elapsed_s=0.5 * WAIT_MIN_S, speed_px_s=2.1 * WAIT_MIN_PX / WAIT_MIN_S)


def test_few_events_put_a_look_off_but_not_for_long():
    assert not is_due(elapsed_s=0.9 * WAIT_MAX_S, events=EVENTS_MIN - 1)
    assert is_due(elapsed_s=WAIT_MAX_S, events=EVENTS_MIN - 1)


@pytest.mark.parametrize(
    ("case", "waits"), [({}, True), ({"is_sure": False}, False), ({"sizes_per_s": FAST, "speed_px_s": 400.0}, False)]
)
def test_patience_puts_off_sure_looks_at_what_is_slow_and_no_others(case, waits):
    assert is_due(elapsed_s=WAIT_MIN_S, patience=1.0, **case)
    assert is_due(elapsed_s=WAIT_MIN_S, patience=2.0, **case) is not waits
    assert is_due(elapsed_s=2 * WAIT_MIN_S, patience=2.0, **case)


@given(
    speed_px_s=st.floats(0, 3000),
    sizes_per_s=st.floats(0, 3 * FAST_SIZES_PER_S),
    patience=st.floats(1, 3),
    share=st.floats(0, 0.999),
)
def test_none_is_due_before_the_earliest_however_many_events_come(speed_px_s, sizes_per_s, patience, share):
    earliest_s = LookPace(2.0, 0.1).earliest_s(speed_px_s, sizes_per_s, patience)
    given_ = {"speed_px_s": speed_px_s, "sizes_per_s": sizes_per_s, "patience": patience}
    assert not is_due(elapsed_s=share * earliest_s, events=10**6, **given_)
