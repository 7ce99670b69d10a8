"""Frames last as long as the tracking asks for, the same whatever its thread does."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest

from etd_ros.boxes import iou
from etd_ros.engine import track
from etd_ros.events import Events, concatenate
from etd_ros.longest_frames import FRAMES_LATER, LongestFrames
from etd_ros.settings import settings_from_mapping
from etd_ros.simulation import Path, Scene, SensorConfig, Sprite, Waypoint, simulate
from etd_ros.simulation.textures import checks, smooth_noise
from etd_ros.stream import Restart, StreamBatch
from etd_ros.targets import TargetStart

START_NS = 1_000_000_000
SIZE_PX, SPEED_PX_S = 16, 1200.0
FLIGHT_S = 0.16
NO_LIMIT = settings_from_mapping({"contours.frame_motion": 100.0})


def asked_after(durations_s: list[float], longest: LongestFrames) -> list[float]:
    """The limits of the frames after those for which so much was asked, in one thread."""
    limits_s = []
    for duration_s in durations_s:
        longest.ask(duration_s)
        limits_s.append(longest.next_s())
    return limits_s


def test_what_is_asked_for_holds_for_a_frame_some_frames_later():
    asked_s = [0.001 * number for number in range(1, 20)]
    assert asked_after(asked_s, LongestFrames()) == [math.inf] * FRAMES_LATER + asked_s[:-FRAMES_LATER]


def test_that_is_the_third_frame_after_it():
    assert asked_after([0.001, 0.002, 0.003], LongestFrames()) == [math.inf, math.inf, 0.001]


def test_a_new_stream_has_no_limit_until_its_own_frames_were_tracked():
    longest = LongestFrames()
    asked_after([0.001] * 10, longest)
    longest.start_stream()
    assert asked_after([0.002] * 4, longest) == [math.inf] * FRAMES_LATER + [0.002] * (4 - FRAMES_LATER)


def test_two_new_streams_one_after_the_other_are_as_one():
    longest = LongestFrames()
    asked_after([0.001] * 10, longest)
    longest.start_stream()
    asked_after([0.002], longest)
    longest.start_stream()
    assert asked_after([0.003] * 4, longest) == [math.inf] * FRAMES_LATER + [0.003] * (4 - FRAMES_LATER)


def test_the_conversion_waits_for_the_tracking_and_gets_the_same_limits():
    asked_s = [0.001 * number for number in range(1, 200)]
    longest = LongestFrames()
    limits_s: list[float] = []
    converting = threading.Thread(target=lambda: limits_s.extend(longest.next_s() for _ in asked_s))
    converting.start()
    for duration_s in asked_s:
        longest.ask(duration_s)
    converting.join()
    assert limits_s == [math.inf] * FRAMES_LATER + asked_s[:-FRAMES_LATER]


def test_who_waits_goes_on_when_the_tracking_ends_and_nobody_waits_until_it_begins_again():
    longest = LongestFrames()
    limits_s: list[float] = []
    converting = threading.Thread(target=lambda: limits_s.extend(longest.next_s() for _ in range(FRAMES_LATER + 3)))
    converting.start()
    longest.close()
    converting.join()
    assert limits_s == [math.inf] * (FRAMES_LATER + 3)
    longest.open()
    assert asked_after([0.001] * 3, longest) == [math.inf] * FRAMES_LATER + [0.001] * (3 - FRAMES_LATER)


def thrown(*, speed_px_s: float = SPEED_PX_S, seed: int = 4) -> tuple[Scene, Events]:
    """Checks that fly over the sensor before a wall, and their events."""
    rng = np.random.default_rng(seed)
    wall = 0.5 + 0.1 * smooth_noise(rng, 180, 240)
    path = Path([Waypoint(0.0, 20.0, 80.0), Waypoint(1.0, 20.0 + speed_px_s, 80.0)])
    thing = Sprite("thing", checks(rng, SIZE_PX, SIZE_PX, cell=4), np.ones((SIZE_PX, SIZE_PX)), path)
    scene = Scene(240, 180, FLIGHT_S, wall, (thing,))
    sensor = SensorConfig(noise_rate_hz=1000.0, step_px=0.5)
    return scene, concatenate(list(simulate(scene, seed=seed, start_ns=START_NS, config=sensor)))


SCENE, EVENTS = thrown()
TARGET = TargetStart("thing", SCENE.box("thing", 0.0), START_NS)


def batches(events: Events = EVENTS, *, cut: int = 3000, restart: Restart | None = None) -> list[StreamBatch]:
    pieces = [events[first : first + cut] for first in range(0, len(events), cut)]
    return [StreamBatch(piece, None if number else restart) for number, piece in enumerate(pieces)]


def flight(**options):
    """What a box is worth a thousand times a second, held until the next one, and how long the frames last (s)."""
    steps = list(track(batches(), [TARGET], **options))
    overlaps = []
    for time_s in np.arange(0.02, FLIGHT_S - 0.005, 0.001):
        held = [step for step in steps if step.frame.stamp_ns <= START_NS + time_s * 1e9][-1]
        box = held.reports[0].box
        overlaps.append(0.0 if box is None else float(iou(np.array([box]), SCENE.box("thing", time_s))[0]))
    durations_s = [(step.frame.stamp_ns - step.frame.start_ns) * 1e-9 for step in steps]
    return np.array(overlaps), np.array(durations_s)


def test_a_fast_target_ends_frames_before_it_has_left_its_box():
    overlaps, durations_s = flight()
    held, long_s = flight(settings=NO_LIMIT)
    a_twentieth_s = 0.05 * SIZE_PX / SPEED_PX_S
    assert np.median(long_s) > 1.8 * a_twentieth_s
    # It moves as fast as it is measured to, which is not known at first.
    assert durations_s[20:].max() < 1.1 * a_twentieth_s
    assert overlaps.mean() > held.mean() + 0.03
    assert overlaps.min() > 0.75


def again(restart: Restart, cut: int = 1000) -> list[StreamBatch]:
    """The same flight in a new stream, 10 s later; on a larger sensor if its size is what starts it."""
    width, height = (300, 200) if restart is Restart.SIZE else (EVENTS.width, EVENTS.height)
    later = Events(EVENTS.t + 10**10, EVENTS.x, EVENTS.y, EVENTS.p, width, height)
    return batches(later, cut=cut, restart=restart)


LATER = TargetStart("later", SCENE.box("thing", 0.0), START_NS + 10**10)


@pytest.mark.parametrize("cut", [200, 10**9])
def test_frames_of_a_fast_target_do_not_depend_on_threads_and_cuts(cut):
    def rows(cut: int, *, threads: bool):
        steps = track([*batches(cut=cut), *again(Restart.GAP, cut)], [TARGET, LATER], threads=threads)
        return [(step.frame.start_ns, step.frame.stamp_ns, step.frame.data.tobytes(), step.reports) for step in steps]

    expected = rows(1000, threads=False)
    assert rows(cut, threads=True) == expected
    assert rows(cut, threads=False) == expected


@pytest.mark.parametrize("restart", [Restart.GAP, Restart.SIZE])
def test_the_first_frames_of_a_stream_do_not_depend_on_how_fast_a_target_of_the_last_one_was(restart):
    # A target that starts later than its stream asks for nothing in its first frames.
    late = TargetStart("late", LATER.box, LATER.stamp_ns + 10**10)

    def first_stamps(streams: list[StreamBatch], *targets: TargetStart) -> list[int]:
        return [step.frame.stamp_ns for step in track(streams, targets) if step.frame.stamp_ns > 10**10][:4]

    alone = [batch if number else StreamBatch(batch.events, None) for number, batch in enumerate(again(restart))]
    assert first_stamps([*batches(), *again(restart)], TARGET, late) == first_stamps(alone, late)


def test_frames_of_a_target_that_is_slow_are_as_if_nobody_asked():
    scene, events = thrown(speed_px_s=60.0)
    start = TargetStart("thing", scene.box("thing", 0.0), START_NS)

    def stamps(**options) -> list[int]:
        return [step.frame.stamp_ns for step in track(batches(events), [start], **options)]

    assert stamps() == stamps(settings=NO_LIMIT)
