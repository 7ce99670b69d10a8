"""Other packages that do a part of the event path, each behind the same interface: a `Subject`.

A package that is not installed gives none. Each gets the same events in its own form, made beforehand.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import timedelta
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from etd_ros.benchmarking.measure import Subject
from etd_ros.events import Events, concatenate

PACKAGES = {
    "dv_processing": "dv-processing",
    "frames2py": "frames2py",
    "tonic": "tonic",
    "evt3": "evt3",
    "expelliarmus": "expelliarmus",
}
"""Names to install by names to import."""

DV_DECAYS = {"linear": ("LINEAR", 1e-6), "undecayed": ("NONE", 1e6), "exponential": ("EXPONENTIAL", 1e6)}
"""dv-processing's decay functions with a parameter: intensity per us, unused, time constant (us)."""

DV_EVENT_CONTRIBUTION = 0.15
TONIC_FRAMES_MAX = 4
EVT3_HEADER = b"% evt 3.0\n% end\n"
EVT3_TRIGGER = 0xA
"""The code of a trigger word, at which expelliarmus gives up."""


def is_installed(module: str) -> bool:
    """Whether a peer can be imported here."""
    return importlib.util.find_spec(module) is not None


def missing_packages() -> list[str]:
    """The peers that are not installed, by the names to install."""
    return [name for module, name in PACKAGES.items() if not is_installed(module)]


def converters(messages: Sequence[Events], frame_ends: Sequence[int], *, all_peers: bool) -> list[Subject]:
    """Peers that turn events into frames or surfaces.

    Args:
        messages: the events as they come.
        frame_ends: after how many events each of our frames ended: the peers make theirs there.
        all_peers: not only the dv-processing accumulators to beat.
    """
    events = concatenate(messages)
    pieces = _pieces(messages, frame_ends)
    subjects = []
    if is_installed("dv_processing"):
        store = _dv_store(events)
        for decay in DV_DECAYS if all_peers else ("linear", "undecayed"):
            accumulator = _dv_accumulator(events, decay)
            subjects.append(_dv_frames(f"dv-processing {decay}", accumulator, accumulator.clear, store, pieces))
        accumulator = _dv_accumulator(events, "linear")
        whole = _pieces(messages, ())
        subjects.append(_dv_frames("dv-processing linear, no frames", accumulator, accumulator.clear, store, whole))
        if all_peers:
            surface = importlib.import_module("dv_processing").TimeSurface((events.width, events.height))
            subjects.append(_dv_frames("dv-processing TimeSurface", surface, surface.reset, store, pieces))
    if all_peers and is_installed("frames2py"):
        subjects.append(_frames2py_frames(events, pieces))
    if all_peers and frame_ends and is_installed("tonic"):
        subjects.append(_tonic_surfaces(events, frame_ends))
    return subjects


def readouts(events: Events) -> list[Subject]:
    """Peers' generation of one frame from what these events left behind."""
    subjects = []
    if is_installed("dv_processing"):
        accumulator, store = _dv_accumulator(events, "linear"), _dv_store(events)

        def refill() -> None:
            accumulator.clear()
            accumulator.accept(store)

        subjects.append(Subject("dv-processing linear", accumulator.generateFrame, prepare=refill))
        surface = importlib.import_module("dv_processing").TimeSurface((events.width, events.height))
        surface.accept(store)
        subjects.append(Subject("dv-processing TimeSurface", surface.generateFrame))
    if is_installed("frames2py"):
        surface = _frames2py_surface(events)
        surface.accumulate(_frames2py_events(events))
        subjects.append(Subject("frames2py TimeSurface", surface.read))
    return subjects


def noise_filters(messages: Sequence[Events], window_s: float) -> list[Subject]:
    """Peers' background-activity filters."""
    if not is_installed("dv_processing"):
        return []
    noise = importlib.import_module("dv_processing").noise
    events = concatenate(messages)
    store = _dv_store(events)
    stores = [store.slice(start, stop - start) for start, stop, _ in _pieces(messages, ())]
    # It keeps the time of the last event for good, so every run needs a new one.
    current: dict[str, Any] = {}

    def prepare() -> None:
        size = (events.width, events.height)
        current["filter"] = noise.BackgroundActivityNoiseFilter(size, timedelta(seconds=window_s))

    def run() -> None:
        background = current["filter"]
        for part in stores:
            background.accept(part)
            background.generateEvents()

    return [Subject("dv-processing noise filter", run, len(events), prepare)]


def evt3_message_decoders(payloads: Sequence[bytes], size: tuple[int, int], units: int) -> list[Subject]:
    """Peers that decode evt3 as it comes, message by message."""
    if not is_installed("evt3"):
        return []
    decoder = importlib.import_module("evt3").Decoder(*size)

    def run() -> None:
        for payload in payloads:
            decoder.feed(payload)

    return [Subject("evt3 (Rust) Decoder.feed", run, units, decoder.reset)]


@contextmanager
def evt3_block_decoders(block: bytes, size: tuple[int, int], units: int) -> Iterator[list[Subject]]:
    """Peers that decode one block of evt3; one of them reads files only, so a temporary one is there meanwhile."""
    subjects = []
    if is_installed("evt3"):
        decode_bytes = importlib.import_module("evt3").decode_bytes
        subjects.append(Subject("evt3 (Rust) decode_bytes", lambda: decode_bytes(block, *size), units))
    with TemporaryDirectory() as folder:
        if is_installed("expelliarmus") and not (np.frombuffer(block, "<u2") >> 12 == EVT3_TRIGGER).any():
            path = Path(folder) / "block.raw"
            path.write_bytes(EVT3_HEADER + block)
            wizard = importlib.import_module("expelliarmus").Wizard(encoding="evt3")
            subjects.append(Subject("expelliarmus Wizard.read", lambda: wizard.read(path), units))
        yield subjects


def _pieces(messages: Sequence[Events], frame_ends: Sequence[int]) -> list[tuple[int, int, bool]]:
    """(first event, stop, whether a frame ends) of the messages, cut where frames end."""
    message_ends = np.cumsum([len(events) for events in messages]).tolist()
    bounds = sorted({0, *message_ends, *frame_ends})
    ends = set(frame_ends)
    return [(start, stop, stop in ends) for start, stop in pairwise(bounds)]


def _dv_store(events: Events) -> Any:
    """The events as dv-processing keeps them, times in us."""
    store = importlib.import_module("dv_processing").EventStore()
    columns = (events.t // 1000, events.x, events.y, events.p.astype(np.bool_))
    for event in zip(*(column.tolist() for column in columns), strict=True):
        store.push_back(*event)
    return store


def _dv_accumulator(events: Events, decay: str) -> Any:
    accumulator = importlib.import_module("dv_processing").Accumulator
    function, parameter = DV_DECAYS[decay]
    kind = getattr(accumulator.Decay, function)
    return accumulator(
        (events.width, events.height), kind, parameter, False, DV_EVENT_CONTRIBUTION, 1.0, 0.0, 0.0, False
    )


def _dv_frames(name: str, peer: Any, clear: Any, store: Any, pieces: Sequence[tuple[int, int, bool]]) -> Subject:
    """A dv-processing class that accepts stores and generates frames."""
    parts = [(store.slice(start, stop - start), ends) for start, stop, ends in pieces]

    def run() -> None:
        for part, is_frame_end in parts:
            peer.accept(part)
            if is_frame_end:
                peer.generateFrame()

    return Subject(name, run, pieces[-1][1], clear)


def _frames2py_events(events: Events) -> npt.NDArray[np.void]:
    array = np.empty(len(events), importlib.import_module("frames2py").EVENT_DTYPE)
    array["t"], array["x"], array["y"], array["p"] = events.t // 1000, events.x, events.y, events.p
    return array


def _frames2py_surface(events: Events) -> Any:
    return importlib.import_module("frames2py").Accumulator((events.width, events.height), "time_surface")


def _frames2py_frames(events: Events, pieces: Sequence[tuple[int, int, bool]]) -> Subject:
    surface, array = _frames2py_surface(events), _frames2py_events(events)
    parts = [(array[start:stop], ends) for start, stop, ends in pieces]

    def run() -> None:
        for part, is_frame_end in parts:
            surface.accumulate(part)
            if is_frame_end:
                surface.read()

    return Subject("frames2py TimeSurface", run, len(events), surface.reset)


def _tonic_surfaces(events: Events, frame_ends: Sequence[int]) -> Subject:
    """The first few surfaces only: tonic keeps all of them, and is slow."""
    to_timesurface = importlib.import_module("tonic.functional").to_timesurface_numpy
    frames = min(TONIC_FRAMES_MAX, len(frame_ends))
    first = events[: frame_ends[frames - 1]]
    array = np.empty(len(first), [("t", "<i8"), ("x", "<i8"), ("y", "<i8"), ("p", "<i8")])
    array["t"], array["x"], array["y"], array["p"] = first.t // 1000, first.x, first.y, first.p
    interval_us = max(1, int(array["t"][-1] - array["t"][0]) // frames)
    size = (first.width, first.height, 2)
    return Subject(
        "tonic to_timesurface", lambda: to_timesurface(array, size, interval_us, float(interval_us)), len(first)
    )
