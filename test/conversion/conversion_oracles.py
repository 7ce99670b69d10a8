"""Slow, literal versions of what the kernels do, and events for the tests."""

from __future__ import annotations

import math
import os
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Reader

from etd_ros.events import Events, concatenate
from etd_ros.recordings import open_recording

DATA = Path(os.environ.get("ETD_DATA", Path(__file__).parents[3] / "shared" / "data"))

DVS_MSGS_RECORD = np.dtype([("x", "<u2"), ("y", "<u2"), ("sec", "<u4"), ("nsec", "<u4"), ("p", "u1")])


def make_events(t, x, y, p, width, height):
    x, y = np.asarray(x, np.uint16), np.asarray(y, np.uint16)
    return Events(np.asarray(t, np.int64), x, y, np.asarray(p, np.uint8), width, height)


def random_events(seed, n, width, height, duration_ns, start_ns=10**18):
    rng = np.random.default_rng(seed)
    t = start_ns + np.sort(rng.integers(0, duration_ns, n))
    return make_events(t, rng.integers(0, width, n), rng.integers(0, height, n), rng.integers(0, 2, n), width, height)


def slider_depth_events(messages):
    """The first messages of slider_depth, whose ROS 1 EventArrays hold packed 13-byte records."""
    arrays = []
    with Reader(DATA / "slider_depth" / "slider_depth.bag") as reader:
        connections = [c for c in reader.connections if c.msgtype == "dvs_msgs/msg/EventArray"]
        for _, (_, _, raw) in zip(range(messages), reader.messages(connections), strict=False):
            body = 16 + int.from_bytes(raw[12:16], "little") + 8
            count = int.from_bytes(raw[body : body + 4], "little")
            arrays.append(np.frombuffer(raw, DVS_MSGS_RECORD, count, body + 4))
    array = np.concatenate(arrays)
    t = array["sec"].astype(np.int64) * 10**9 + array["nsec"]
    order = np.argsort(t, kind="stable")
    return make_events(t[order], array["x"][order], array["y"][order], array["p"][order], 240, 180)


def first_events(path, count):
    """At least `count` events from the start of a recording, or all, as they are converted."""
    batches, total = [], 0
    with open_recording(path) as recording:
        for batch in recording.streams():
            batches.append(batch.events)
            total += len(batch.events)
            if total >= count:
                break
    return concatenate(batches)


def closed_form(events, start_ns, stamp_ns):
    """Frame data from each pixel's last event, in exact arithmetic."""
    data = np.zeros((events.height, events.width, 2), np.uint8)
    duration_ns = stamp_ns - start_ns
    for t, x, y, p in zip(events.t.tolist(), events.x, events.y, events.p, strict=True):
        level = math.floor(Fraction(255 * (t - start_ns), duration_ns) + Fraction(1, 2)) if duration_ns else 255
        data[y, x, 1 - p] = max(1, level)
    return data


def filled_up(data, cell_size):
    """Pixels without events beyond the right and bottom border, so that all cells are whole."""
    height, width, _ = data.shape
    return np.pad(data, ((0, -height % cell_size), (0, -width % cell_size), (0, 0)))


def histogram_nzge(data, cell_size=4, log_base=256.0):
    data = filled_up(data, cell_size)
    entropies = []
    for top in range(0, data.shape[0], cell_size):
        for left in range(0, data.shape[1], cell_size):
            cell = data[top : top + cell_size, left : left + cell_size]
            channels = []
            for channel in (0, 1):
                counts, _ = np.histogram(cell[:, :, channel], bins=256, range=(0, 256))
                shares = counts[counts > 0] / counts.sum()
                channels.append(float(-(shares * np.log(shares)).sum() / np.log(log_base)))
            entropies.append(sum(channels) / 2)
    not_zero = [entropy for entropy in entropies if entropy > 1e-12]
    return sum(not_zero) / len(not_zero) if not_zero else 0.0


def entropy(counts):
    shares = np.asarray([count for count in counts if count]) / sum(counts)
    return float(-(shares * np.log(shares)).sum() / np.log(256))


def channel_entropy(events, pixels=16):
    """Entropy of a channel of which so many pixels have events of distinct levels."""
    return entropy([1] * int(events) + [pixels - int(events)])


CHANNEL_ENTROPIES = np.array([channel_entropy(events) for events in range(17)])


def channel_levels(data, cell_size=4):
    """The levels of each cell's two channels: (cells, 2, pixels), cells row by row."""
    data = filled_up(data, cell_size)
    rows, columns = data.shape[0] // cell_size, data.shape[1] // cell_size
    cells = data.reshape(rows, cell_size, columns, cell_size, 2).transpose(0, 2, 4, 1, 3)
    return cells.reshape(rows * columns, 2, cell_size * cell_size)


def distinct_levels_sums(data):
    """Number of cells with events, and the sum of their channels' entropies as if all levels were distinct."""
    counts = np.count_nonzero(channel_levels(data), axis=2)
    return int(counts.any(axis=1).sum()), float(CHANNEL_ENTROPIES[counts].sum())


def sampled_loss(data, step=8):
    """What the channels of every step-th cell lack of the entropy of distinct levels."""
    return sum(
        channel_entropy(np.count_nonzero(levels)) - entropy(np.bincount(levels))
        for channels in channel_levels(data)[::step]
        for levels in channels
    )


def literal_atsltd(events, *, alpha, max_duration_ns, stride):
    """Frames as (start, stamp, events, end) by AtsltdConverter's definition, event by event."""
    frames = []
    start, first = int(events.t[0]), 0
    ratio, sampled, failed, next_check = 1.0, False, 0, stride
    for i, t in enumerate(events.t.tolist()):
        limit = start + max_duration_ns
        if t > limit:
            if i > first:
                frames.append((start, limit, i - first, "time_limit"))
            start = t if t > limit + max_duration_ns else limit
            first, ratio, sampled, failed, next_check = i, 1.0, False, 0, stride
            # The event may still come after the limit of the frame that it begins.
            assert t <= start + max_duration_ns
        if i + 1 - first != next_check:
            continue
        next_check += stride
        if t == start:
            continue
        data = closed_form(events[first : i + 1], start, t)
        touched, total = distinct_levels_sums(data)
        bound = total / 2 / touched
        if not sampled and bound >= alpha * (1 - 1e-9) and touched >= 256:
            ratio, sampled = 1 - 0.9 * 8 * sampled_loss(data) / total, True
        if bound * ratio < alpha * (1 - 1e-9):
            continue
        exact = histogram_nzge(data)
        if exact >= alpha:
            frames.append((start, t, i + 1 - first, "nzge"))
            start, first, ratio, sampled, failed, next_check = t, i + 1, 1.0, False, 0, stride
            continue
        ratio, failed = exact / bound, failed + 1
        if failed > 8:
            next_check += stride * (2 ** (failed - 8) - 1)
    return frames


def cut(events, cuts):
    """The events in batches that end at the given indices."""
    edges = [0, *sorted(min(c, len(events)) for c in cuts), len(events)]
    return [events[a:b] for a, b in pairwise(edges)]


def frames_of(converter, batches):
    return [frame for batch in batches for frame in converter.convert(batch)]


def assert_same_frames(actual, expected):
    assert [(f.start_ns, f.stamp_ns, f.events, f.nzge, f.end) for f in actual] == [
        (f.start_ns, f.stamp_ns, f.events, f.nzge, f.end) for f in expected
    ]
    for a, b in zip(actual, expected, strict=True):
        np.testing.assert_array_equal(a.data, b.data)
