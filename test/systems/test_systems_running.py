"""Any system on a recording: starts, states, pictures, times and errors."""

from __future__ import annotations

import time

import numpy as np
import pytest
import system_recordings as simulated

from etd_ros.boxes import Box, BoxError
from etd_ros.engine import track
from etd_ros.events import Events
from etd_ros.recordings.interface import RecordedImage
from etd_ros.recordings.loaded import LoadedRecording
from etd_ros.systems.interface import CompareError
from etd_ros.systems.registry import SYSTEMS
from etd_ros.systems.running import run_system
from etd_ros.targets import TargetError, TargetStart
from etd_ros.tracking import METHODS, TargetState

SLOW = "tld-reconstruction"
"""Each of its parts is tested with another system."""
TESTED = [name for name in SYSTEMS if name != SLOW]
ONE_OF_EACH_FEED = list({system.feed: name for name, system in SYSTEMS.items() if name != SLOW}.values())
COMPARED = [name for name in TESTED if name not in METHODS]
VIDEO = [name for name, system in SYSTEMS.items() if system.feed == "video"]
OF_EVENTS = [name for name in COMPARED if name not in VIDEO]


@pytest.mark.parametrize("name", SYSTEMS)
def test_targets_are_idle_before_their_start_and_tracked_from_it_on(name):
    starts = [simulated.start("left", 0.1), simulated.start("right", 0.2)]
    steps = list(run_system(name, simulated.recording(), starts))
    stamps_ns = [step.stamp_ns for step in steps]
    assert stamps_ns == sorted(stamps_ns)
    for number, target in enumerate(starts):
        reports = [step.reports[number] for step in steps]
        assert {report.name for report in reports} == {target.name}
        for stamp_ns, report in zip(stamps_ns, reports, strict=True):
            assert (report.state is TargetState.IDLE) == (stamp_ns < target.stamp_ns)
            assert (report.box is None) == (report.state is not TargetState.TRACKING)
        assert next(report for report in reports if report.state is not TargetState.IDLE).box is not None


def test_a_target_on_video_starts_on_the_picture_nearest_to_its_stamp():
    """Pictures are at 110 and 130 ms."""
    box, second_ns = simulated.scene().box("left", 0.11), simulated.stamp_ns(0.13)

    def boxes(time_s: float) -> dict[int, Box | None]:
        start = TargetStart("left", box, simulated.stamp_ns(time_s))
        steps = run_system("kcf", simulated.recording(), [start])
        return {step.stamp_ns: step.reports[0].box for step in steps if step.stamp_ns >= second_ns}

    on_it, just_after, long_after = boxes(0.11), boxes(0.112), boxes(0.124)
    assert just_after == on_it
    assert just_after[second_ns] != box
    assert long_after[second_ns] == box


@pytest.mark.parametrize("name", TESTED)
def test_every_step_shows_what_the_system_saw_and_what_it_took(name):
    sizes = {(simulated.HEIGHT, simulated.WIDTH), (simulated.HEIGHT, simulated.WIDTH, 2)}
    for step in run_system(name, simulated.recording(), [simulated.start("left")]):
        assert step.picture.dtype == np.uint8
        assert step.picture.shape in sizes
        assert step.picture.any()
        assert step.seconds > 0


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("threads", [False, True])
def test_the_engines_methods_give_the_boxes_of_the_engine(name, threads):
    starts = [simulated.start("left"), simulated.start("right")]
    steps = run_system(name, simulated.recording(), starts, threads=threads)
    expected = track(simulated.recording().streams(), starts, method=name)
    assert [(step.stamp_ns, step.reports) for step in steps] == [
        (step.frame.stamp_ns, step.reports) for step in expected
    ]


@pytest.mark.parametrize("name", COMPARED)
def test_targets_that_are_run_together_get_the_boxes_that_each_gets_alone(name):
    starts = [simulated.start("left"), simulated.start("right", 0.2)]
    together = simulated.tracks_of(name, starts)
    for target in starts:
        alone = simulated.tracks_of(name, [target])[target.name]
        # A system that answers when it likes takes no steps before its first target has started.
        started = [[row.box for row in rows if row.state != "idle"] for rows in (together[target.name], alone)]
        assert started[0] == started[1]
        assert any(started[0])


@pytest.mark.parametrize("name", COMPARED)
def test_boxes_do_not_depend_on_what_comes_later(name):
    starts = [simulated.start("left")]
    whole = list(run_system(name, simulated.recording(), starts))
    end_ns = simulated.stamp_ns(0.4)
    events = [batch.events.between(0, end_ns) for batch in simulated.recording().streams()]
    images = [image for image in simulated.recording().images() if image.stamp_ns < end_ns]
    cut = LoadedRecording([(part, None, None) for part in events if len(part)], images)
    steps = list(run_system(name, cut, starts))
    assert len(steps) > 5
    for step, expected in zip(steps, whole, strict=False):
        assert step.stamp_ns == expected.stamp_ns
        assert [report.box for report in step.reports] == [report.box for report in expected.reports]


@pytest.mark.parametrize("name", TESTED)
def test_a_run_from_the_middle_is_given_nothing_from_before(name):
    from_ns = simulated.stamp_ns(0.2)
    starts = [simulated.start("left", 0.25)]
    steps = list(run_system(name, simulated.recording(), starts, from_ns=from_ns))
    assert steps[0].stamp_ns >= from_ns
    assert steps[-1].reports[0].state is not TargetState.IDLE
    since = simulated.recording().since(from_ns)
    alone = run_system(name, since, starts)
    assert [step.reports for step in steps] == [step.reports for step in alone]


@pytest.mark.parametrize("name", ONE_OF_EACH_FEED)
def test_recordings_that_are_not_in_memory_start_in_the_middle_too(name):
    class Streamed:
        width, height = simulated.WIDTH, simulated.HEIGHT

        def streams(self, config=None):
            return simulated.recording().streams(config)

        def images(self):
            return simulated.recording().images()

    options = {"starts": [simulated.start("left", 0.25)], "from_ns": simulated.stamp_ns(0.2)}
    of_memory, streamed = (
        [(step.stamp_ns, step.reports[0].box) for step in run_system(name, source, **options)]
        for source in (simulated.recording(), Streamed())
    )
    assert streamed == of_memory


def test_reading_does_not_count_as_the_systems_time():
    class Slow:
        width, height = simulated.WIDTH, simulated.HEIGHT

        def streams(self, config=None):
            return simulated.recording().streams(config)

        def images(self):
            for image in simulated.recording().images():
                end_s = time.perf_counter() + 0.02
                while time.perf_counter() < end_s:
                    pass
                yield image

    start_s = time.perf_counter()
    seconds = sum(step.seconds for step in run_system("kcf", Slow(), [simulated.start("left")]))
    taken_s = time.perf_counter() - start_s
    images = len(list(simulated.recording().images()))
    assert 0 < seconds <= taken_s - images * 0.02


@pytest.mark.parametrize("name", VIDEO)
def test_a_recording_without_images_is_refused_for_systems_that_need_them(name):
    with pytest.raises(CompareError, match=f"'{name}' needs video.*record the camera's frames"):
        run_system(name, simulated.with_images([]), [simulated.start("left")])


@pytest.mark.parametrize("name", OF_EVENTS)
def test_systems_that_are_fed_with_events_need_no_images(name):
    assert list(run_system(name, simulated.with_images([]), [simulated.start("left")]))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (np.zeros((45, 60), np.uint8), "the video is 60x45, the sensor 120x90"),
        (np.zeros((90, 120, 2), np.uint8), "no grey or colour picture"),
        (np.zeros((90, 120), np.float32), "no grey or colour picture"),
    ],
)
def test_images_that_are_no_video_of_the_sensor_are_refused(data, words):
    source = simulated.with_images([RecordedImage(simulated.stamp_ns(0.2), "cam", data)])
    with pytest.raises(CompareError, match=words):
        list(run_system("kcf", source, [simulated.start("left")]))


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("bits", [8, 16])
def test_colour_and_16_bit_video_is_tracked_as_its_grey_8_bits_are(channels, bits):
    grey = [image.data for image in simulated.recording().images()]
    stamps_ns = [image.stamp_ns for image in simulated.recording().images()]
    others = [np.repeat(data[..., None], channels, axis=2) for data in grey]
    if bits == 16:
        others = [data.astype(np.uint16) << 8 for data in others]
    images = [RecordedImage(stamp_ns, "cam", data) for stamp_ns, data in zip(stamps_ns, others, strict=True)]
    starts = [simulated.start("left")]
    steps = list(run_system("kcf", simulated.with_images(images), starts))
    expected = list(run_system("kcf", simulated.recording(), starts))
    assert [step.reports[0].box for step in steps] == [step.reports[0].box for step in expected]
    assert {step.picture.shape for step in steps} == {(90, 120, 3) if channels == 3 else (90, 120)}


@pytest.mark.parametrize("name", OF_EVENTS)
@pytest.mark.parametrize("change", ["size", "time"])
def test_streams_that_end_are_refused_in_one_line(name, change):
    batches = [batch.events for batch in simulated.recording().streams()]
    again = batches[0]
    if change == "size":
        later = np.full(len(again), batches[-1].t[-1])
        again = Events(later, again.x, again.y, again.p, 240, 180)
    source = LoadedRecording([(events, None, None) for events in (*batches, again)], [])
    words = "the sensor size changes from 120x90 to 240x180" if change == "size" else "time goes back"
    with pytest.raises(CompareError, match=words) as caught:
        list(run_system(name, source, [simulated.start("left")]))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", TESTED)
@pytest.mark.parametrize(
    ("starts", "error"),
    [
        ([TargetStart("a", Box(10, 10, 20, 20)), TargetStart("a", Box(10, 10, 20, 20))], TargetError),
        ([TargetStart("a", Box(300, 10, 20, 20))], BoxError),
        ([TargetStart("a", Box(10, 10, 20, 20), simulated.START_NS - 10**9)], TargetError),
    ],
)
def test_targets_that_cannot_be_started_are_refused_by_every_system(name, starts, error):
    with pytest.raises(error):
        list(run_system(name, simulated.recording(), starts))


def test_unknown_systems_are_refused_with_the_known_ones():
    with pytest.raises(CompareError, match="unknown system 'kfc': choose one of etd-plus, .*kcf"):
        run_system("kfc", simulated.recording(), [simulated.start("left")])
