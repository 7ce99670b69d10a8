import copy
import pickle

import numpy as np
import pytest
from conversion_oracles import assert_same_frames, closed_form, make_events, random_events

from etd_ros.conversion import FixedCountConfig, FixedCountConverter, FrameEnd, nzge
from etd_ros.conversion.accumulator import FrameAccumulator
from etd_ros.conversion.frame_buffers import BUFFERS_MAX

MS = 1_000_000


def somewhere(seed, width, height, start_ns):
    """Events of a part of the sensor, another one with each seed; sometimes few."""
    rng = np.random.default_rng(seed)
    left, top = rng.integers(0, width), rng.integers(0, height)
    right, bottom = rng.integers(left, width), rng.integers(top, height)
    number = int(rng.choice([1, 5, 200]))
    t = start_ns + 1 + np.sort(rng.integers(0, MS - 1, number))
    x, y = rng.integers(left, right + 1, number), rng.integers(top, bottom + 1, number)
    return make_events(t, x, y, rng.integers(0, 2, number), width, height)


@pytest.mark.parametrize("cell_size", [2, 3, 4, 5, 8, 9])
@pytest.mark.parametrize(("width", "height"), [(64, 48), (70, 50), (19, 13), (5, 3), (1, 1)])
def test_nothing_of_an_earlier_frame_is_seen_in_one_that_has_its_memory(width, height, cell_size):
    accumulator = FrameAccumulator(width, height, cell_size)
    memories = set()
    for number in range(60):
        memories.add(accumulator._buffers.memory.ctypes.data)
        start_ns = (number + 1) * MS
        events = somewhere(number, width, height, start_ns)
        accumulator.accept(events)
        accumulator.start_ns = start_ns
        accumulator.add(events, 0, len(events), start_ns + MS)
        frame = accumulator.finish(start_ns + MS, FrameEnd.WINDOW)
        np.testing.assert_array_equal(frame.data, closed_form(events, start_ns, start_ns + MS))
        assert frame.nzge == pytest.approx(nzge(frame.data, cell_size), abs=1e-12)
    assert len(memories) <= 2


def frames(count):
    events = random_events(1, 100 * count, 40, 30, 10 * MS)
    return FixedCountConverter(40, 30, FixedCountConfig(count=100)).convert(events)


@pytest.mark.parametrize("part", [lambda data: data, lambda data: data[3:20, ::2, 1], lambda data: memoryview(data)])
def test_what_is_held_of_a_frame_stays_as_it_was(part):
    held = [(part(frame.data), np.array(part(frame.data))) for frame in frames(3 * BUFFERS_MAX)]
    assert len(held) == 3 * BUFFERS_MAX
    for now, before in held:
        np.testing.assert_array_equal(np.asarray(now), before)


def test_a_frame_is_not_to_be_written_to():
    frame = next(frames(1))
    with pytest.raises(ValueError, match="read-only"):
        frame.data[0, 0, 0] = 1


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda converter: pickle.loads(pickle.dumps(converter))])
def test_a_copy_of_a_converter_goes_on_where_it_was(copied):
    events = random_events(1, 1000, 41, 31, 10 * MS)
    converter = FixedCountConverter(41, 31, FixedCountConfig(count=100))
    assert len(list(converter.convert(events[:350]))) == 3
    other = copied(converter)
    ours, others = (list(each.convert(events[350:])) for each in (converter, other))
    assert len(ours) == 7
    assert_same_frames(others, ours)
