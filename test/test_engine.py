"""Events to boxes without ROS: cuts, restarts, sizes, images and starts."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from etd_ros.boxes import Box, BoxError
from etd_ros.cadence import Cadence
from etd_ros.conversion import ConversionError, nzge
from etd_ros.detection import DetectionError
from etd_ros.engine import EngineError, FrameSource, ImageSource, Part, SearchRegions, Step, make_tracker, track
from etd_ros.evaluation import TracksWriter
from etd_ros.events import Events, concatenate
from etd_ros.reconstruction import HighPassFilter, ReconstructionError, SynchronisedReconstruction
from etd_ros.recordings import open_recording
from etd_ros.settings import Settings, settings_from_mapping
from etd_ros.simulation import Path, Scene, Sprite, Waypoint, simulate
from etd_ros.stream import Restart, StreamBatch, StreamGuard
from etd_ros.targets import TargetError, TargetStart, targets_from_file
from etd_ros.tracking import METHODS, ContourConfig, TargetState, TrackingError

WIDTH, HEIGHT = 96, 72
START_NS = 1_000_000_000
BOX = Box(18.0, 22.0, 28.0, 28.0)


def make_events(start_ns: int = START_NS, duration_s: float = 0.25) -> Events:
    """A framed square that moves to the right before a grey wall."""
    rng = np.random.default_rng(2)
    surface = np.full((28, 28), 0.9)
    surface[4:-4, 4:-4] = rng.uniform(0.15, 0.4, (20, 20))
    path = Path([Waypoint(0.0, 32.0, 36.0), Waypoint(1.0, 132.0, 36.0)])
    sprite = Sprite("square", surface, np.ones_like(surface), path)
    scene = Scene(WIDTH, HEIGHT, duration_s, 0.4 + 0.1 * rng.random((HEIGHT, WIDTH)), (sprite,))
    return concatenate(list(simulate(scene, seed=1, start_ns=start_ns)))


EVENTS = make_events()
LARGER = Events(EVENTS.t + 10**10, EVENTS.x, EVENTS.y, EVENTS.p, WIDTH + 30, HEIGHT + 10)


def cut_at(events: Events, cuts: Sequence[int]) -> list[StreamBatch]:
    borders = sorted({0, len(events), *(min(cut, len(events)) for cut in cuts)})
    return [StreamBatch(events[first:last], None) for first, last in pairwise(borders)]


def rows(steps: Sequence[Step]) -> list[tuple]:
    """Everything that a step says, comparable."""
    return [
        (
            step.frame.stamp_ns,
            step.frame.data.tobytes(),
            None if step.image is None else step.image.tobytes(),
            step.reports,
        )
        for step in steps
    ]


def tracked(streams: Sequence[StreamBatch], *targets: TargetStart, method: str = "etd") -> list[Step]:
    return list(track(streams, targets or [TargetStart("square", BOX)], method=method))


WHOLE = {method: rows(tracked(cut_at(EVENTS, []), method=method)) for method in METHODS}


@pytest.mark.parametrize("method", METHODS)
@settings(deadline=None, max_examples=8)
@given(cuts=st.lists(st.integers(1, len(EVENTS) - 1), max_size=30))
def test_frames_images_and_boxes_do_not_depend_on_how_events_are_cut(method, cuts):
    assert rows(tracked(cut_at(EVENTS, cuts), method=method)) == WHOLE[method]


def with_noise(events: Events) -> Events:
    """The square in front of noise that is everywhere to its right."""
    rng = np.random.default_rng(3)
    t = np.sort(rng.integers(int(events.t[0]), int(events.t[-1]), 40_000))
    x, y = rng.integers(60, WIDTH, len(t)), rng.integers(0, HEIGHT, len(t))
    noise = Events(t, x.astype(np.uint16), y.astype(np.uint16), (t % 2).astype(np.uint8), WIDTH, HEIGHT)
    both = np.concatenate([events.to_structured(), noise.to_structured()])
    return Events.from_structured(both[np.argsort(both["t"], kind="stable")], WIDTH, HEIGHT)


FOCUSED = settings_from_mapping({"atsltd.entropy_region": "targets"})


def focused(method: str, cuts: Sequence[int] = (), *, threads: bool = True) -> list[Step]:
    """Tracked with NZGE measured round the target."""
    streams = cut_at(with_noise(EVENTS), cuts)
    return list(track(streams, [TargetStart("square", BOX)], method=method, settings=FOCUSED, threads=threads))


@pytest.mark.parametrize("method", ["etd-plus", "etd", "etd-nr"])
def test_entropy_in_the_search_region_is_that_of_its_cells(method):
    steps = focused(method)
    box: Box | None = None
    for step in steps:
        data = step.frame.data.copy()
        if box is not None:
            region = box.scaled(1.5)
            inside = np.zeros(data.shape[:2], bool)
            left, top = max(0, int(region.x) // 4 * 4), max(0, int(region.y) // 4 * 4)
            right, bottom = (-(-int(np.ceil(edge)) // 4) * 4 for edge in (region.x + region.w, region.y + region.h))
            inside[top:bottom, left:right] = True
            data[~inside] = 0
        assert step.frame.nzge == pytest.approx(nzge(data), abs=1e-12)
        box = step.reports[0].box or box
    assert steps[-1].reports[0].state is TargetState.TRACKING


def test_a_busy_background_does_not_end_the_frames_of_a_target_in_its_own_region():
    assert len(focused("etd-nr")) < len(tracked(cut_at(EVENTS, []), method="etd-nr")) * 2


@settings(deadline=None, max_examples=5)
@given(cuts=st.lists(st.integers(1, len(EVENTS) - 1), max_size=20), threads=st.booleans())
def test_search_regions_give_the_same_boxes_however_events_are_cut(cuts, threads):
    assert rows(focused("etd", cuts, threads=threads)) == rows(focused("etd"))


@pytest.mark.parametrize(("region", "conversion_thread"), [("sensor", "read_ahead"), ("targets", "MainThread")])
def test_recordings_are_read_ahead_wherever_nzge_is_measured(region, conversion_thread, monkeypatch):
    readers, converters = set(), set()

    def streams():
        for batch in cut_at(EVENTS, [2000, 4000]):
            readers.add(threading.current_thread().name)
            yield batch

    convert = FrameSource.frames

    def noted(source, events):
        converters.add(threading.current_thread().name)
        return convert(source, events)

    monkeypatch.setattr(FrameSource, "frames", noted)
    chosen = settings_from_mapping({"atsltd.entropy_region": region})
    assert list(track(streams(), [TargetStart("square", BOX)], method="etd-nr", settings=chosen))
    assert readers == {"read_ahead"}
    assert converters == {conversion_thread}
    assert "read_ahead" not in {thread.name for thread in threading.enumerate()}


def test_a_new_stream_and_a_new_sensor_size_forget_the_search_regions():
    regions = SearchRegions()
    regions.boxes = [BOX]
    source = FrameSource("atsltd", WIDTH, HEIGHT, FOCUSED, regions)
    assert regions.boxes is None
    first = [(frame.stamp_ns, frame.nzge) for frame in source.frames(EVENTS)]
    regions.boxes = [Box(80.0, 60.0, 8.0, 8.0)]
    source.reset()
    assert regions.boxes is None
    assert [(frame.stamp_ns, frame.nzge) for frame in source.frames(EVENTS)] == first


def test_the_first_frame_after_a_restart_is_measured_over_the_whole_sensor():
    later = with_noise(make_events(START_NS + 2_000_000_000))
    streams = [StreamBatch(with_noise(EVENTS), None), StreamBatch(later, Restart.GAP)]
    steps = list(track(streams, [TargetStart("square", BOX)], method="etd-nr", settings=FOCUSED))
    after = next(step for step in steps if step.frame.stamp_ns > int(later.t[0]))
    assert after.frame.nzge == pytest.approx(nzge(after.frame.data), abs=1e-12)


def test_events_one_at_a_time_give_the_same_boxes():
    part = EVENTS[: len(EVENTS) // 4]
    one_by_one = tracked(cut_at(part, range(len(part))), method="etd-nr")
    assert len(one_by_one) > 1
    assert rows(one_by_one) == rows(tracked(cut_at(part, []), method="etd-nr"))


def test_the_square_is_followed():
    steps = tracked(cut_at(EVENTS, []))
    assert len(steps) > 10
    last = steps[-1]
    box = last.reports[0].box
    moved = (last.frame.stamp_ns - START_NS) / 1e9 * 100
    assert box is not None
    assert box.center[0] == pytest.approx(32 + moved, abs=5)
    assert box.center[1] == pytest.approx(36, abs=5)


@pytest.mark.parametrize("method", METHODS)
def test_images_come_with_the_methods_that_recover_and_stand_at_the_frames_stamps(method):
    steps = tracked(cut_at(EVENTS, range(0, len(EVENTS), 500)), method=method)
    stamps = [step.frame.stamp_ns for step in steps]
    if not METHODS[method].recovers:
        assert all(step.image is None for step in steps)
        return
    cadence = Cadence(METHODS[method].image_interval_s)
    due = [stamp_ns for stamp_ns in stamps if cadence.is_due(stamp_ns)]
    reference = SynchronisedReconstruction(HighPassFilter(WIDTH, HEIGHT))
    for stamp_ns in due:
        reference.request(stamp_ns)
    reference.push(EVENTS)
    expected = dict(reference.ready())
    assert [step.frame.stamp_ns for step in steps if step.image is not None] == due == list(expected)
    for step in steps:
        assert step.image is None or np.array_equal(step.image, expected[step.frame.stamp_ns])


def test_a_step_back_in_time_starts_frames_and_targets_again():
    guard = StreamGuard()
    target = TargetStart("square", BOX, START_NS)
    twice = [batch for events in (EVENTS, EVENTS) for batch in guard.feed(events)]
    assert [batch.restart for batch in twice] == [None, Restart.TIME_STEP_BACK]
    first, both = tracked(twice[:1], target), tracked(twice, target)
    again = both[len(first) :]
    assert rows(both[: len(first)]) == rows(first)
    assert [row[:3] for row in rows(again)] == [row[:3] for row in rows(first)], "frames and images start afresh"
    assert again[0].reports[0].box == pytest.approx(first[0].reports[0].box, abs=3)
    assert again[-1].reports[0].box == pytest.approx(first[-1].reports[0].box, abs=3)


def test_a_restart_drops_the_unfinished_frame():
    cut = EVENTS[: len(EVENTS) // 3]
    later = make_events(START_NS + 2_000_000_000)
    streams = [StreamBatch(cut, None), StreamBatch(later, Restart.GAP)]
    frames = [step.frame for step in tracked(streams, method="etd-nr")]
    after = [frame for frame in frames if frame.stamp_ns > int(cut.t[-1])]
    alone = [step.frame for step in tracked([StreamBatch(later, None)], method="etd-nr")]
    assert [(frame.stamp_ns, frame.events) for frame in after] == [(frame.stamp_ns, frame.events) for frame in alone]


def test_a_new_size_makes_a_new_engine():
    guard = StreamGuard()
    streams = [batch for events in (EVENTS, LARGER) for batch in guard.feed(events)]
    assert streams[1].restart is Restart.SIZE
    target = TargetStart("square", BOX, START_NS)
    steps = tracked(streams, target)
    larger_steps = [step for step in steps if step.frame.data.shape == (HEIGHT + 10, WIDTH + 30, 2)]
    first = steps[: len(steps) - len(larger_steps)]
    assert {step.frame.data.shape for step in first} == {(HEIGHT, WIDTH, 2)}
    assert larger_steps[0].reports[0].box == pytest.approx(first[0].reports[0].box, abs=3), "it starts at its box again"


def test_a_target_is_idle_until_its_stamp():
    stamp_ns = START_NS + 100_000_000
    for step in tracked(cut_at(EVENTS, []), TargetStart("late", BOX, stamp_ns)):
        (report,) = step.reports
        assert (report.state is TargetState.IDLE) == (step.frame.stamp_ns < stamp_ns)
        assert (report.box is None) == (report.state is not TargetState.TRACKING)


def test_reports_come_in_the_order_of_the_targets():
    names = ["b", "a", "c"]
    for step in tracked(cut_at(EVENTS, []), *(TargetStart(name, BOX) for name in names)):
        assert [report.name for report in step.reports] == names


def test_a_target_well_before_the_first_event_is_refused_and_one_just_before_is_not():
    first_ns = int(EVENTS.t[0])
    assert tracked(cut_at(EVENTS, []), TargetStart("square", BOX, first_ns - 490_000_000))
    with pytest.raises(TargetError, match="before the first event"):
        tracked(cut_at(EVENTS, []), TargetStart("square", BOX, first_ns - 510_000_000))


@pytest.mark.parametrize(
    ("targets", "error"),
    [
        ([TargetStart("twice", BOX), TargetStart("twice", BOX)], TargetError),
        ([TargetStart("off", Box(200.0, 1.0, 5.0, 5.0))], BoxError),
        ([TargetStart("a,b", BOX)], TrackingError),
    ],
)
def test_a_target_that_cannot_be_is_refused(targets, error):
    with pytest.raises(error):
        tracked(cut_at(EVENTS, []), *targets)


def test_no_events_give_no_steps():
    assert tracked([]) == []


@pytest.mark.parametrize("method", [name for name, kind in METHODS.items() if not kind.contours])
def test_methods_that_choose_proposals_name_the_opencv_that_they_need(method, monkeypatch):
    monkeypatch.delattr(cv2, "ximgproc")
    with pytest.raises(DetectionError, match="opencv-contrib-python-headless"):
        make_tracker(method, 64, 48, Settings())


def test_contours_are_followed_with_any_opencv(monkeypatch):
    monkeypatch.delattr(cv2, "ximgproc")
    tracker = make_tracker("etd-plus", 64, 48, Settings())
    tracker.start("square", Box(20, 20, 8, 8))
    assert list(tracker.targets) == ["square"]


def test_an_unknown_method_or_conversion_is_refused():
    with pytest.raises(TrackingError, match="etd-nr"):
        tracked([], method="guess")
    with pytest.raises(EngineError, match="atsltd, atsltd_fine, fixed_window, fixed_count"):
        FrameSource("guess", WIDTH, HEIGHT, Settings())


def test_events_of_another_sensor_are_refused():
    with pytest.raises(ConversionError, match="96x72|64x48"):
        FrameSource("atsltd", 64, 48, Settings()).frames(EVENTS)
    with pytest.raises(ReconstructionError, match="96x72|64x48"):
        ImageSource(64, 48, Settings()).take(Part(StreamBatch(EVENTS, None), None))


@pytest.mark.parametrize("conversion", ["atsltd", "fixed_window", "fixed_count"])
def test_the_noise_filter_goes_before_every_conversion(conversion):
    quiet = settings_from_mapping({"noise_filter.window_s": 0.002, "fixed_count.count": 500})
    plain = settings_from_mapping({"noise_filter.window_s": 0.0, "fixed_count.count": 500})
    kept, everything = (
        sum(frame.events for frame in FrameSource(conversion, WIDTH, HEIGHT, chosen).frames(EVENTS))
        for chosen in (quiet, plain)
    )
    assert 0 < kept < everything


@pytest.mark.parametrize("method", METHODS)
def test_threads_change_nothing(method):
    streams = [
        *cut_at(EVENTS, range(0, len(EVENTS), 700)),
        StreamBatch(make_events(START_NS + 2_000_000_000), Restart.GAP),
        StreamBatch(LARGER, Restart.SIZE),
    ]
    targets = [TargetStart("square", BOX), TargetStart("late", BOX, START_NS + 100_000_000)]
    with_threads, without = (list(track(streams, targets, method=method, threads=threads)) for threads in (True, False))
    assert len(without) > 20
    assert rows(with_threads) == rows(without)


def test_the_tracks_of_the_bundled_recording_are_the_same_bytes_with_and_without_threads(repository, tmp_path):
    bag = repository / "bags" / "demo"
    targets = targets_from_file(bag / "boxes.csv")
    for threads in (True, False):
        with open_recording(bag) as recording, TracksWriter(tmp_path / f"{threads}.csv") as tracks:
            for step in track(recording.streams(), targets, threads=threads):
                tracks.write_reports(step.frame.stamp_ns, step.reports)
    assert (tmp_path / "True.csv").read_bytes() == (tmp_path / "False.csv").read_bytes()
    assert (tmp_path / "True.csv").read_text().count("\n") > 1000


def test_stopping_early_leaves_no_thread_behind():
    before = threading.active_count()
    steps = track(cut_at(EVENTS, range(0, len(EVENTS), 100)), [TargetStart("square", BOX)])
    assert next(steps)
    assert threading.active_count() > before
    steps.close()
    assert threading.active_count() == before


def test_an_error_of_the_recording_comes_after_the_steps_before_it_and_leaves_no_thread_behind():
    def broken():
        yield from cut_at(EVENTS, range(0, len(EVENTS), 700))
        msg = "the file breaks off"
        raise EngineError(msg)

    before = threading.active_count()
    steps = []
    with pytest.raises(EngineError, match="breaks off"):
        steps.extend(track(broken(), [TargetStart("square", BOX)], method="etd"))
    assert rows(steps) == WHOLE["etd"]
    assert threading.active_count() == before


def test_a_frame_without_its_events_has_no_image():
    frame = next(FrameSource("atsltd", WIDTH, HEIGHT, Settings()).frames(EVENTS))
    with pytest.raises(EngineError, match="were not given"):
        ImageSource(WIDTH, HEIGHT, Settings()).take(Part(None, frame))


@pytest.mark.parametrize("start_ns", [0, 2**62 - 10**12], ids=["at 0", "at the latest time"])
def test_boxes_do_not_depend_on_when_the_stream_is(start_ns):
    shift_ns = start_ns - int(EVENTS.t[0])
    shifted = Events(EVENTS.t + shift_ns, EVENTS.x, EVENTS.y, EVENTS.p, WIDTH, HEIGHT)
    expected = [(stamp_ns + shift_ns, *rest) for stamp_ns, *rest in WHOLE["etd"]]
    assert rows(tracked(cut_at(shifted, [1000]))) == expected


@pytest.mark.parametrize("hours", [1, 1000, 100_000])
def test_frames_and_images_long_into_a_stream_are_those_of_a_new_one(hours):
    later = Events(EVENTS.t + hours * 3600 * 10**9, EVENTS.x, EVENTS.y, EVENTS.p, WIDTH, HEIGHT)
    first, last = tracked(cut_at(EVENTS, [])), tracked(cut_at(later, []))
    steps = tracked([StreamBatch(EVENTS, None), StreamBatch(later, None)])[-len(last) :]
    assert [step.frame.stamp_ns for step in steps] == [step.frame.stamp_ns for step in last]
    assert len(last) == len(first)
    for step, expected in zip(steps, last, strict=True):
        assert np.array_equal(step.frame.data, expected.frame.data)
        # Ticks of the reconstruction begin with the stream, so they are rounded elsewhere.
        assert np.abs(step.image.astype(int) - expected.image).max() <= 1


def test_the_tracker_is_told_of_what_class_a_target_is(monkeypatch):
    told = []
    monkeypatch.setattr(ContourConfig, "for_class", lambda config, class_id: told.append(class_id) or config)
    assert list(track(cut_at(EVENTS, []), [TargetStart("square", BOX, class_id="person")]))
    assert told == ["person"]
