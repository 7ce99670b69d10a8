"""Mean-shift clusters of events, and the target among them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from etd_ros.boxes import Box
from etd_ros.events import Events, concatenate
from etd_ros.systems.event_clusters import NEAR_PX, PACKET_EVENTS, EventClusterTracker, clusters
from etd_ros.systems.mean_shift import mean_shift

WIDTH, HEIGHT = 240, 180
MS = 1_000_000
SECOND = 10**9


def literal_mean_shift(points, bandwidth):
    """The definition, one point after the other."""
    modes, votes, passed = [], [], set()
    for start in range(len(points)):
        if start in passed:
            continue
        mean, way = points[start], np.zeros(len(points), int)
        while True:
            squares = ((points - mean) ** 2).sum(axis=1)
            near = squares <= bandwidth**2
            weights = np.where(near, np.exp(-squares / (2 * bandwidth**2)), 0)
            moved = (weights[:, None] * points).sum(axis=0) / weights.sum()
            way += near
            shift, mean = math.dist(mean, moved), moved
            if shift < 1e-3 * bandwidth:
                break
        passed |= set(np.flatnonzero(way).tolist())
        close = [number for number, mode in enumerate(modes) if math.dist(mode, mean) < bandwidth / 2]
        if close:
            modes[close[0]] = (modes[close[0]] + mean) / 2
            votes[close[0]] = votes[close[0]] + way
        else:
            modes.append(mean)
            votes.append(way)
    return np.array(modes), np.argmax(votes, axis=0)


@given(st.integers(0, 10_000), st.integers(1, 200), st.sampled_from([0.04, 0.15, 0.6, 1.5]))
@hypothesis_settings(deadline=None, max_examples=60)
def test_modes_and_members_are_those_of_the_definition(seed, count, bandwidth):
    rng = np.random.default_rng(seed)
    centres = rng.uniform(0, 1, (5, 3))
    points = np.clip(centres[rng.integers(0, 5, count)] + rng.normal(0, 0.03, (count, 3)), 0, 1 - 1e-9)
    points[::7] = rng.uniform(0, 1, points[::7].shape)
    modes, labels = mean_shift(points, bandwidth)
    expected_modes, expected_labels = literal_mean_shift(points, bandwidth)
    np.testing.assert_allclose(modes, expected_modes, atol=1e-9)
    np.testing.assert_array_equal(labels, expected_labels)


def test_two_blobs_are_two_clusters_at_their_centres_until_the_bandwidth_holds_both():
    rng = np.random.default_rng(0)
    centres = np.array([[0.3, 0.4, 1.0], [0.6, 0.4, 1.0]])
    points = np.repeat(centres, 400, axis=0) + rng.normal(0, 0.02, (800, 3)) * (1, 1, 0)
    modes, labels = mean_shift(points, 0.15)
    np.testing.assert_allclose(modes, centres, atol=0.004)
    np.testing.assert_array_equal(labels, np.repeat([0, 1], 400))
    (mode,), labels = mean_shift(points, 0.6)
    np.testing.assert_allclose(mode, centres.mean(axis=0), atol=0.004)
    assert not labels.any()


def test_a_lone_point_is_a_cluster_of_its_own():
    modes, labels = mean_shift(np.array([[0.5, 0.5, 1.0]]), 0.15)
    np.testing.assert_array_equal(modes, [[0.5, 0.5, 1.0]])
    assert labels.tolist() == [0]


def blob(rng, x, y, count, first_ns, last_ns, width=WIDTH, height=HEIGHT, radius=10):
    """Events in a square round a point."""
    t = np.sort(rng.integers(first_ns, last_ns, count))
    columns, rows = (np.round(centre + rng.uniform(-radius, radius, count)) for centre in (x, y))
    return Events(
        t, columns.astype(np.uint16), rows.astype(np.uint16), rng.integers(0, 2, count, np.uint8), width, height
    )


def together(*parts):
    events = concatenate(parts)
    order = np.argsort(events.t, kind="stable")
    return Events(events.t[order], events.x[order], events.y[order], events.p[order], events.width, events.height)


def two_blobs(rng, packets, scale=1):
    """A blob that goes right by 2 pixels in 4 ms and one that stands still; 1,800 events in 4 ms."""
    return [
        together(
            *(
                blob(
                    rng, x * scale, y * scale, 900 * scale**2, number * 4 * MS, (number + 1) * 4 * MS,
                    WIDTH * scale, HEIGHT * scale, 10 * scale,
                )
                for x, y in ((40 + 2 * number, 60), (180, 130))
            )
        )
        for number in range(packets)
    ]  # fmt: skip


def test_a_packets_clusters_have_the_smallest_boxes_round_their_events():
    packet = together(
        blob(np.random.default_rng(1), 50, 60, 900, 0, 4 * MS), blob(np.random.default_rng(2), 180, 130, 900, 0, 4 * MS)
    )
    found = sorted(clusters(packet), key=lambda cluster: cluster.centre)
    assert [cluster.box for cluster in found] == [Box(40, 50, 21, 21), Box(170, 120, 21, 21)]
    for cluster, centre in zip(found, [(50, 60), (180, 130)], strict=True):
        assert math.dist(cluster.centre, centre) < 1


@pytest.mark.parametrize("scale", [1, 2])
def test_a_moving_blob_is_followed_and_not_the_one_that_stands_still(scale):
    tracker = EventClusterTracker()
    tracker.start(0, Box(30 * scale, 50 * scale, 21 * scale, 21 * scale))
    packets = two_blobs(np.random.default_rng(3), 50, scale)
    answers = [answer for packet in packets for answer in tracker.update(packet)]
    # The noise filter takes the very first events, so packets end a little after their 4 ms.
    assert len(answers) == 49
    for stamp_ns, answer in answers:
        x = (40 + 2 * (stamp_ns / (4 * MS) - 0.5)) * scale
        assert answer.box is not None
        assert math.dist(answer.box.center, (x, 60 * scale)) < 3 * scale
        assert answer.box.w == pytest.approx(23 * scale, abs=4 * scale)


def test_answers_do_not_depend_on_how_events_are_cut_into_batches():
    events = concatenate(two_blobs(np.random.default_rng(4), 12))

    def answers(size):
        tracker = EventClusterTracker()
        tracker.start(20 * MS, Box(40, 50, 20, 20))
        batches = [events[first : first + size] for first in range(0, len(events), size)]
        return [answer for batch in batches for answer in tracker.update(batch)]

    whole = answers(len(events))
    assert whole[0][0] >= 20 * MS
    assert [(stamp_ns, answer.box) for stamp_ns, answer in whole] == [
        (stamp_ns, answer.box) for stamp_ns, answer in answers(777)
    ]


def test_a_blob_that_is_gone_is_lost_and_found_again_where_it_was():
    rng = np.random.default_rng(5)
    tracker = EventClusterTracker()
    tracker.start(0, Box(170, 120, 21, 21))
    phases = [(180, 130), (60, 60), (180, 130)]
    states = []
    for number, (x, y) in enumerate(phases):
        first_ns = number * SECOND
        batch = blob(rng, x, y, 3 * PACKET_EVENTS + 200, first_ns, first_ns + 12 * MS)
        states.append([answer.box is not None for _, answer in tracker.update(batch)])
    assert math.dist(*phases[:2]) > NEAR_PX
    assert states[0] == [True] * 3
    # A packet with events of both has the cluster of each.
    assert not any(states[1][1:])
    assert states[2][-1]


@pytest.mark.parametrize(("hits", "is_found"), [(20, False), (30, True)])
def test_a_blob_that_passes_behind_something_is_found_where_the_filter_expects_it(hits, is_found):
    hidden = 15
    tracker = EventClusterTracker()
    tracker.start(0, Box(30, 50, 21, 21))
    packets = two_blobs(np.random.default_rng(7), hits + hidden + 1)
    still = [blob(np.random.default_rng(8), 180, 130, 1800, n * 4 * MS, (n + 1) * 4 * MS) for n in range(len(packets))]
    seen = [*packets[:hits], *still[hits : hits + hidden], packets[-1], packets[-1]]
    seen[-1] = dataclasses.replace(seen[-1], t=seen[-1].t + 4 * MS)
    answers = [answer for packet in seen for _, answer in tracker.update(packet)]
    assert not any(answer.box for answer in answers[hits + 1 : hits + hidden - 1])
    assert (answers[-1].box is not None) == is_found


def test_noise_is_left_out_of_the_boxes():
    rng = np.random.default_rng(6)
    noise_t = np.sort(rng.integers(0, 400 * MS, 200))
    noise = Events(
        noise_t,
        rng.integers(0, WIDTH, 200).astype(np.uint16),
        rng.integers(0, HEIGHT, 200).astype(np.uint16),
        np.ones(200, np.uint8),
        WIDTH,
        HEIGHT,
    )
    tracker = EventClusterTracker()
    tracker.start(0, Box(90, 80, 21, 21))
    answers = list(tracker.update(together(noise, blob(rng, 100, 90, 180_000, 0, 400 * MS))))
    boxes = [answer.box for _, answer in answers]
    assert sum(box == Box(90, 80, 21, 21) for box in boxes) > 0.9 * len(boxes)
