"""Images at stamps: complete, in order, the same live and offline, in bounded memory."""

from __future__ import annotations

import weakref
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.events import Events
from etd_ros.reconstruction import HighPassFilter, ReconstructionError, SynchronisedReconstruction
from etd_ros.reconstruction.synchronised import BATCH_BYTES

WIDTH, HEIGHT = 10, 8
EVENT_BYTES = 13


def events_at(times, seed: int = 0) -> Events:
    rng = np.random.default_rng(seed)
    count = len(times)
    return Events(
        np.asarray(times, np.int64),
        rng.integers(0, WIDTH, count).astype(np.uint16),
        rng.integers(0, HEIGHT, count).astype(np.uint16),
        rng.integers(0, 2, count).astype(np.uint8),
        WIDTH,
        HEIGHT,
    )


def reconstruction(**options) -> SynchronisedReconstruction:
    return SynchronisedReconstruction(HighPassFilter(WIDTH, HEIGHT), **options)


def plain_images(events: Events, stamps) -> list[np.ndarray]:
    """The definition: for each stamp, the events before it, then the image."""
    high_pass = HighPassFilter(WIDTH, HEIGHT)
    start_ns = int(events.t[0])
    images = []
    for stamp_ns in stamps:
        high_pass.integrate(events.between(start_ns, stamp_ns))
        images.append(high_pass.image(stamp_ns))
        start_ns = stamp_ns
    return images


def test_an_image_holds_the_events_before_its_stamp_and_none_at_it():
    sync = reconstruction()
    sync.push(events_at([1_000, 2_000]))
    before = HighPassFilter(WIDTH, HEIGHT)
    before.integrate(events_at([1_000, 2_000])[:1])
    sync.request(2_000)
    ((stamp_ns, image),) = sync.ready()
    assert stamp_ns == 2_000
    np.testing.assert_array_equal(image, before.image(2_000))


def test_an_image_waits_for_an_event_at_its_stamp_or_later():
    sync = reconstruction()
    sync.push(events_at([1_000, 1_999]))
    sync.request(2_000)
    assert list(sync.ready()) == []
    assert sync.held_bytes == 0
    sync.push(events_at([2_000]))
    assert [stamp_ns for stamp_ns, _ in sync.ready()] == [2_000]


@settings(deadline=None, max_examples=40)
@given(
    steps=st.lists(st.integers(0, 400_000), min_size=30, max_size=200),
    cuts=st.sets(st.integers(1, 199), max_size=10),
    picks=st.lists(st.integers(0, 199), min_size=1, max_size=8),
    lag=st.integers(-3, 3),
)
def test_live_and_offline_orders_give_the_same_images(steps, cuts, picks, lag):
    events = events_at(1_000_000 + np.cumsum(steps))
    stamps = sorted(int(events.t[min(pick, len(events) - 1)]) for pick in picks)
    expected = plain_images(events, stamps)

    edges = [0, *sorted(cut for cut in cuts if cut < len(events)), len(events)]
    live = reconstruction()
    waiting = list(stamps)
    found = []
    for first, last in pairwise(edges):
        live.push(events[first:last])
        # The stamps lag behind the events or run ahead of them, as on two topics.
        reached_ns = int(events.t[min(max(last - 1 + 10 * lag, 0), len(events) - 1)])
        while waiting and waiting[0] <= reached_ns:
            live.request(waiting.pop(0))
        found += list(live.ready())
    for stamp_ns in waiting:
        live.request(stamp_ns)
    found += list(live.ready())

    offline = reconstruction()
    for stamp_ns in stamps:
        offline.request(stamp_ns)
    offline.push(events)

    for got in (found, list(offline.ready())):
        assert [stamp_ns for stamp_ns, _ in got] == stamps
        for (_, image), wanted in zip(got, expected, strict=True):
            np.testing.assert_array_equal(image, wanted)


def test_events_nobody_asks_for_are_held_in_bounded_memory():
    room = 2 * BATCH_BYTES + 100 * EVENT_BYTES
    sync = reconstruction(held_bytes_max=room)
    for batch in range(20):
        sync.push(events_at(np.arange(40) + 1_000 * batch))
        assert sync.held_bytes <= room
    assert sync.integrated_early == 20 * 40 - 80


def test_what_is_held_keeps_no_larger_arrays_from_being_used_again():
    lent = [np.zeros(1 << 16, dtype) for dtype in (np.int64, np.uint16, np.uint16, np.uint8)]
    freed = [weakref.ref(array) for array in lent]
    sync = reconstruction()
    sync.push(Events(*(array[:10] for array in lent), WIDTH, HEIGHT))
    lent.clear()
    assert [array() for array in freed] == [None] * 4


def test_a_stamp_whose_events_were_integrated_early_still_gets_an_image():
    sync = reconstruction(held_bytes_max=0)
    sync.push(events_at([1_000, 2_000, 3_000]))
    sync.request(2_500)
    assert [stamp_ns for stamp_ns, _ in sync.ready()] == [2_500]


def test_one_huge_batch_with_its_stamps_known_is_not_integrated_early():
    events = events_at(np.arange(1_000) * 1_000)
    sync = reconstruction(held_bytes_max=10)
    sync.request(500_000)
    sync.push(events)
    ((_, image),) = sync.ready()
    np.testing.assert_array_equal(image, plain_images(events, [500_000])[0])
    assert sync.integrated_early == 0


def test_stamps_nobody_serves_are_given_up_and_counted():
    sync = reconstruction()
    for stamp_ns in range((1 << 16) + 5):
        sync.request(stamp_ns)
    assert sync.requests_dropped == 5


def test_a_stamp_back_in_time_waits_for_the_reset_and_survives_it():
    sync = reconstruction()
    sync.push(events_at([1_000, 2_500]))
    sync.request(2_000)
    assert [stamp_ns for stamp_ns, _ in sync.ready()] == [2_000]
    sync.request(1_000)
    assert list(sync.ready()) == [], "the events of the old stream are not those before the new stamp"
    sync.reset()
    events = events_at([500, 1_500], seed=5)
    sync.push(events)
    ((stamp_ns, image),) = sync.ready()
    assert stamp_ns == 1_000
    np.testing.assert_array_equal(image, plain_images(events, [1_000])[0])


def test_a_late_stamp_of_the_old_stream_does_not_stop_the_new_one():
    sync = reconstruction()
    sync.push(events_at([1_000, 90_000]))
    sync.reset()
    sync.request(90_000)
    sync.push(events_at([1_000, 2_000]))
    assert list(sync.ready()) == []
    for stamp_ns in (1_500, 2_500):
        sync.request(stamp_ns)
    sync.push(events_at([3_000]))
    assert [stamp_ns for stamp_ns, _ in sync.ready()] == [1_500, 2_500]
    assert sync.requests_dropped == 1


def test_stamps_that_stepped_back_do_not_wait_forever_for_a_reset():
    room = 2 * BATCH_BYTES + 100 * EVENT_BYTES
    sync = reconstruction(held_bytes_max=room)
    sync.push(events_at([1_000, 2_500]))
    sync.request(2_000)
    assert len(list(sync.ready())) == 1
    found = []
    for number in range(20):
        sync.request(1_000 + number)
        sync.push(events_at(np.arange(40) + 3_000 + 100 * number))
        found += [stamp_ns for stamp_ns, _ in sync.ready()]
        assert sync.held_bytes <= room
    assert found == list(range(1_000, 1_020))


def test_a_loop_of_a_recording_gives_the_same_images_again_whichever_topic_is_ahead():
    events = events_at(1_000_000 + 10_000 * np.arange(200))
    stamps = [int(events.t[index]) for index in (50, 100, 150)]
    for stamps_are_ahead in (False, True):
        sync = reconstruction()
        rounds = []
        for number in range(3):
            if stamps_are_ahead:
                sync.request(stamps[0])
            if number:
                sync.reset()
            found = []
            for stamp_ns in stamps[1:] if stamps_are_ahead else stamps:
                sync.request(stamp_ns)
            sync.push(events)
            found += sync.ready()
            assert [stamp_ns for stamp_ns, _ in found] == stamps
            rounds.append(np.stack([image for _, image in found]))
        np.testing.assert_array_equal(rounds[0], rounds[1])
        np.testing.assert_array_equal(rounds[0], rounds[2])


def test_a_reset_forgets_events_and_stamps():
    sync = reconstruction()
    sync.push(events_at([1_000, 2_000, 3_000], seed=3))
    sync.request(9_000)
    sync.reset()
    assert sync.held_bytes == 0
    events = events_at([10, 20, 30], seed=4)
    sync.request(25)
    sync.push(events)
    ((_, image),) = sync.ready()
    np.testing.assert_array_equal(image, plain_images(events, [25])[0])


def test_events_of_another_sensor_size_are_refused():
    with pytest.raises(ReconstructionError, match="4x4"):
        reconstruction().push(Events.empty(4, 4))
