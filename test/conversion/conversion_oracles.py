"""Slow, literal versions of what the kernels do, and events for the tests."""

from __future__ import annotations

import math
import os
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Reader

from etd_ros.conversion import nzge
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


def losses(data, *, of_sample):
    """What channels lack of the entropy of distinct levels, and the cells with events but without entropy."""
    lost, without_entropy = 0.0, 0
    for index, channels in enumerate(channel_levels(data)):
        if of_sample and index * 2654435761 % 2**32 >= 2**29:
            continue
        exact = [entropy(np.bincount(levels)) for levels in channels]
        lost += sum(channel_entropy(np.count_nonzero(levels)) for levels in channels) - sum(exact)
        without_entropy += bool(channels.any()) and max(exact) < 1e-12
    return lost, without_entropy


def sample_scale(data):
    cells = len(channel_levels(data))
    return cells / sum(index * 2654435761 % 2**32 < 2**29 for index in range(cells))


def literal_atsltd(events, *, alpha, max_duration_ns, stride):
    """Frames as (start, stamp, events, end) by AtsltdConverter's rules, event by event."""
    frames = []
    start, first = int(events.t[0]), 0
    fresh = (0, 0.0, 0.0, 0, stride)
    looked, lost, without, failed, next_check = fresh
    wanted = 2 * alpha * (1 - 1e-9)
    for i, t in enumerate(events.t.tolist()):
        limit = start + max_duration_ns
        if t > limit:
            if i > first:
                frames.append((start, limit, i - first, "time_limit"))
            start = t if t > limit + max_duration_ns else limit
            first = i
            looked, lost, without, failed, next_check = fresh
            # The event may still come after the limit of the frame that it begins.
            assert t <= start + max_duration_ns
        n = i + 1 - first
        if n != next_check:
            continue
        next_check += stride
        if t == start:
            continue
        data = closed_form(events[first : i + 1], start, t)
        touched, total = distinct_levels_sums(data)
        if wanted <= CHANNEL_ENTROPIES[-1] and total < touched * wanted:
            continue
        if not looked and touched >= 256:
            lost, without = (0.9 * sample_scale(data) * value for value in losses(data, of_sample=True))
            looked = n
        if looked and total - lost < (touched - without) * wanted and n < looked + looked // 8:
            continue
        if histogram_nzge(data) >= alpha:
            frames.append((start, t, n, "nzge"))
            start, first = t, i + 1
            looked, lost, without, failed, next_check = fresh
            continue
        looked, (lost, without), failed = n, losses(data, of_sample=False), failed + 1
        next_check += stride * (max(1, min(2 ** max(failed - 8, 0), n // (8 * stride))) - 1)
    return frames


def first_check_that_reaches(events, *, alpha, stride):
    """The number of events of the first frame by the plain definition: checks at every stride, and nothing else."""
    for n in range(stride, len(events) + 1, stride):
        if events.t[n - 1] > events.t[0] and nzge(levels_of(events[:n])) >= alpha:
            return n
    return None


def levels_of(events, start_ns=None):
    """Frame data of all events, quickly: `closed_form` in whole numbers; the frame starts with the first event unless
    said otherwise."""
    start_ns = int(events.t[0]) if start_ns is None else start_ns
    data = np.zeros((events.height, events.width, 2), np.uint8)
    since, duration = events.t - start_ns, int(events.t[-1]) - start_ns
    data[events.y, events.x, 1 - events.p.astype(int)] = np.maximum(1, (510 * since + duration) // (2 * duration))
    return data


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
