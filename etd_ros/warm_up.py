"""Compiles the kernels of a node's stages, or loads them from the cache, before the first real event comes."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from etd_ros.boxes import Box
from etd_ros.conversion import BackgroundActivityFilter, FixedCountConfig, NoiseFilterConfig
from etd_ros.engine import CONVERSIONS, FrameSource
from etd_ros.events import Events
from etd_ros.reconstruction import HighPassFilter, SynchronisedReconstruction
from etd_ros.settings import STAGES, Settings
from etd_ros.stream import StreamGuard
from etd_ros.tracking import ContourConfig, Discovery, MultiTracker
from etd_ros.tracking.camera_slide import CameraSlide
from etd_ros.tracking.contours import Contours
from etd_ros.tracking.growth import stands_alone
from etd_ros.tracking.pointed_object import PointedObject
from etd_ros.tracking.surface import TimeSurface
from msg_adapters import ENCODINGS, Layout, decoder_for
from msg_adapters.header import Header, write_header
from msg_adapters.layout import Writer

SENSOR_SIDE = 48
SQUARE_SIDE = 16
STEPS = 24
TEXTURE_STEPS, TEXTURE_SHARE = 12, 0.05
STEP_NS = 2_000_000
QUIET_NS = 1_000_000_000
SLIDE_FRAMES, SLIDE_NS = 8, 100_000_000
"""Two pictures are taken of so many frames of this time, and compared."""

PACKET_TYPE = "event_camera_msgs/msg/EventPacket"
ARRAY_TYPE = "dvs_msgs/msg/EventArray"
WORDS = np.arange(0, 1 << 16, 1 << 6, dtype="<u2")
"""16-bit words of every code, and a whole number of words of 32 and 64 bits."""


def warm_up(stages: Iterable[str] = tuple(STAGES)) -> None:
    """Run the kernels of these stages of `Settings` on a handful of events: a tenth of a second once all is compiled.

    A node names the stages that it has parameters of; those are the ones that it runs.
    """
    wanted = set(stages)
    for names, run in _RUNS:
        if wanted & names:
            run()


def _decode() -> None:
    """Every type of message in every encoding; events in time order and not."""
    decoder = decoder_for(PACKET_TYPE, Layout.ROS2)
    for encoding in sorted(ENCODINGS):
        list(StreamGuard().feed(decoder.decode(_packet(encoding)).events))
    list(StreamGuard().feed(decoder_for(ARRAY_TYPE, Layout.ROS2).decode(_array()).events))
    times = np.array([1, 0], np.int64)
    zeros = np.zeros(2, np.uint16)
    list(StreamGuard().feed(Events(times, zeros, zeros, zeros.astype(np.uint8), 1, 1)))


def _convert() -> None:
    # Times of a window of more than two seconds do not fit 32 bits, which makes another kernel.
    for window_s in (1.0, 3.0):
        noise_filter = BackgroundActivityFilter(SENSOR_SIDE, SENSOR_SIDE, NoiseFilterConfig(window_s=window_s))
        noise_filter.filter(_moving_square())
    settings = Settings(fixed_count=FixedCountConfig(count=500))
    for conversion in CONVERSIONS:
        list(FrameSource(conversion, SENSOR_SIDE, SENSOR_SIDE, settings).frames(_moving_square()))


def _reconstruct() -> None:
    events = _moving_square()
    reconstruction = SynchronisedReconstruction(HighPassFilter(SENSOR_SIDE, SENSOR_SIDE))
    for stamp_ns in events.t[:: len(events) // 2]:
        reconstruction.request(int(stamp_ns))
    reconstruction.push(events)
    list(reconstruction.ready())


def _track() -> None:
    for tracker, frames in (
        (MultiTracker(SENSOR_SIDE, SENSOR_SIDE), 3),
        (MultiTracker(SENSOR_SIDE, SENSOR_SIDE, contours=ContourConfig()), STEPS),
    ):
        tracker.start("square", Box(8, 8, SQUARE_SIDE, SQUARE_SIDE))
        # It has moved away from this one, as far as its start can tell.
        tracker.start("beside", Box(8 + SQUARE_SIDE, 8, SQUARE_SIDE - 4, SQUARE_SIDE - 4))
        events = _moving_square()
        for step in range(frames):
            now = events.between(step * STEP_NS, (step + 1) * STEP_NS)
            frame = np.zeros((SENSOR_SIDE, SENSOR_SIDE, 2), np.uint8)
            frame[now.y, now.x, now.p] = 255
            # A node that gets its frames as messages may not write to them, which is another type to a kernel.
            frame.flags.writeable = step % 2 == 0
            tracker.update((step + 1) * STEP_NS, frame)
    # There are not many targets here; no camera slides, and no look is at noise alone, at what is held beside another
    # target, or before what moves otherwise.
    slide = CameraSlide(SENSOR_SIDE, SENSOR_SIDE)
    for step in range(SLIDE_FRAMES):
        frame = np.zeros((SENSOR_SIDE, SENSOR_SIDE, 2), np.uint8)
        frame.flags.writeable = step == 0
        slide.take((step + 1) * SLIDE_NS, step * SLIDE_NS, frame)
    surface, everywhere = TimeSurface(SENSOR_SIDE, SENSOR_SIDE), (0, SENSOR_SIDE, 0, SENSOR_SIDE)
    surface.keeps_all = True
    for step in range(2):
        frame = np.zeros((SENSOR_SIDE, SENSOR_SIDE, 2), np.uint8)
        frame.flags.writeable = step % 2 == 0
        surface.take((step + 1) * STEP_NS, frame)
        surface.keep(everywhere)
    surface.shows_noise(everywhere, 0.1)
    own = Contours(Box(8, 8, SQUARE_SIDE, SQUARE_SIDE), 0, ContourConfig()).own
    own.others.note(np.zeros((1, 6)), 1.0, 0)
    stands_alone(surface, Box(8, 8, SQUARE_SIDE, SQUARE_SIDE), 0.1, others=own.others)
    backdrop = own.backdrop
    backdrop.velocity, backdrop.is_settled = (1000.0, 0.0), True
    backdrop.keep_own(*surface.points((0, 8, 0, 8), 0.1), np.array([16.0, 16.0, 1.0, 0.0]), (0.0, 0.0), 0.1)


def _discover() -> None:
    """A texture that moves as before a panning camera, and a square that moves otherwise; a click on it."""
    side = 5 * SENSOR_SIDE
    texture = np.random.default_rng(0).random((side, side)) < TEXTURE_SHARE
    discovery = Discovery(side, side)
    for step in range(TEXTURE_STEPS):
        moved = np.roll(texture, 2 * step, axis=1)
        top = SENSOR_SIDE + 4 * step
        moved[top : top + 2 * SQUARE_SIDE, :SENSOR_SIDE] = texture[: 2 * SQUARE_SIDE, :SENSOR_SIDE]
        frame = np.repeat(moved[:, :, None], 2, axis=2).astype(np.uint8) * 255
        frame.flags.writeable = step % 2 == 0
        discovery.take((step + 1) * 5 * STEP_NS, frame)
        discovery.look(thorough=True)
        PointedObject(side / 2, side / 2, discovery.events.stamp_ns).candidates(discovery)


def _packet(encoding: str) -> bytes:
    writer = Writer(Layout.ROS2)
    write_header(writer, Header(0, ""))
    writer.u32(SENSOR_SIDE)
    writer.u32(SENSOR_SIDE)
    writer.u64(0)
    writer.u64(0)
    writer.string(encoding)
    writer.u8(0)
    writer.byte_sequence(WORDS)
    return writer.finish()


def _array() -> bytes:
    """An EventArray of one event."""
    writer = Writer(Layout.ROS2)
    write_header(writer, Header(0, ""))
    writer.u32(SENSOR_SIDE)
    writer.u32(SENSOR_SIDE)
    writer.u32(1)
    for _ in range(4):
        writer.u32(0)
    return writer.finish()


def _moving_square() -> Events:
    """The outline of a square, a pixel further at each step, and an event long after: frames end for every reason."""
    side = np.arange(SQUARE_SIDE)
    outline_x = np.concatenate([side, side, np.zeros_like(side), np.full_like(side, SQUARE_SIDE - 1)])
    outline_y = np.concatenate([np.zeros_like(side), np.full_like(side, SQUARE_SIDE - 1), side, side])
    step = np.repeat(np.arange(STEPS), len(outline_x))
    x = np.tile(outline_x, STEPS) + 8 + step
    y = np.tile(outline_y, STEPS) + 8
    polarity = np.tile(outline_x, STEPS) < SQUARE_SIDE // 2
    t = step * STEP_NS + np.arange(len(step)) % len(outline_x)
    t[-1] += QUIET_NS
    return Events(
        t.astype(np.int64),
        x.astype(np.uint16),
        y.astype(np.uint16),
        polarity.astype(np.uint8),
        SENSOR_SIDE,
        SENSOR_SIDE,
    )


_RUNS: tuple[tuple[frozenset[str], Callable[[], None]], ...] = (
    (frozenset({"stream"}), _decode),
    (frozenset({"noise_filter", "atsltd", "fixed_window", "fixed_count"}), _convert),
    (frozenset({"reconstruction"}), _reconstruct),
    (frozenset({"detection", "tracking", "contours", "recovery"}), _track),
    (frozenset({"discovery"}), _discover),
)
"""Stages, by the names of their settings, and what runs their kernels."""
