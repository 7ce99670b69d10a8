"""Frames and images of one stamp find each other, and do not wait without bounds."""

import math
import time

import numpy as np

from etd_ros.nodes.tracker import FramePairs
from msg_adapters import ImageMessage

FRAME = np.zeros((4, 5, 2), np.uint8)
IMAGE = np.zeros((4, 5), np.uint8)


def frame(stamp_ns: int) -> ImageMessage:
    return ImageMessage(stamp_ns, "camera", "8UC2", FRAME)


def image(stamp_ns: int) -> ImageMessage:
    return ImageMessage(stamp_ns, "camera", "mono8", IMAGE)


def popped(pairs: FramePairs, known_until_s: float = -math.inf) -> list[tuple[int, bool]]:
    """(stamp, whether there is an image) of all frames that are ready."""
    found = []
    while (pair := pairs.pop(known_until_s)) is not None:
        found.append((pair[1].stamp_ns, pair[2] is not None))
    return found


def test_a_frame_waits_for_its_image_and_a_later_one_ends_the_wait():
    pairs = FramePairs(60.0, 1 << 20)
    for stamp_ns in (1, 2, 3):
        pairs.add_frame(frame(stamp_ns), time.monotonic())
    assert popped(pairs) == []
    pairs.add_image(image(2))
    assert popped(pairs) == [(1, False), (2, True)]
    assert pairs.frames_without_image == 1


def test_frames_that_wait_hold_a_bounded_number_of_bytes():
    pairs = FramePairs(60.0, 3 * FRAME.nbytes)
    found = []
    for stamp_ns in range(10):
        pairs.add_frame(frame(stamp_ns), time.monotonic())
        found += popped(pairs)
    assert found == [(stamp_ns, False) for stamp_ns in range(7)]
    pairs.add_image(image(7))
    assert popped(pairs) == [(7, True)]


def test_a_frame_is_given_up_only_where_every_image_of_its_wait_has_been_seen():
    pairs = FramePairs(60.0, 1 << 20)
    pairs.add_frame(frame(1), time.monotonic())
    assert popped(pairs, time.monotonic() + 59.0) == []
    assert popped(pairs, time.monotonic() + 61.0) == [(1, False)]


def test_a_frame_that_has_no_image_waits_for_none_and_is_not_counted():
    pairs = FramePairs(60.0, 1 << 20)
    pairs.add_frame(frame(1), time.monotonic(), has_image=False)
    pairs.add_frame(frame(2), time.monotonic())
    assert popped(pairs) == [(1, False)]
    pairs.add_image(image(2))
    assert popped(pairs) == [(2, True)]
    assert pairs.frames_without_image == 0


def test_without_a_wait_frames_go_on_at_once():
    pairs = FramePairs(0.0, 1 << 20)
    pairs.add_frame(frame(1), time.monotonic())
    assert popped(pairs) == [(1, False)]
