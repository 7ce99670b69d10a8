"""The nodes as programs, from the first moment of a process to its last: what `ros2 run etd_ros NAME` starts.

A node that is told to leave does so at once, also while its libraries are still being loaded. So nothing is imported
here that takes time.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from importlib import import_module
from types import FrameType
from typing import NoReturn

NODES = ("accumulator", "pipeline", "reconstruction", "replay", "tracker")
LEAVE = (signal.SIGINT, signal.SIGTERM)

Handler = Callable[[int, "FrameType | None"], object] | signal.Handlers


def start(name: str) -> NoReturn:
    """Run the node of a name until it is told to leave; the process ends with its exit code."""
    with _leaving_at_once():
        node = import_module(f"etd_ros.nodes.{name}")
    run(node.main)


def run(main: Callable[[], int]) -> NoReturn:
    """Run a node, and end the process with its exit code."""
    if code := main():
        sys.exit(code)
    # What the node has let go may still be held by cycles, and that holds shared memory. Loading a network may have
    # taken some of it out of what is looked through.
    gc.unfreeze()
    gc.collect()
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    # Python's own end would wait for what threads are still importing: torch, which takes seconds where a node is told
    # to leave soon after its start.
    os._exit(0)


def _leaving_at_once() -> AbstractContextManager[None]:
    """There is nothing to be let go yet. Who has signals ignored, as a shell has for what runs in its background, goes
    on ignoring them."""
    heard = [number for number in LEAVE if signal.getsignal(number) is not signal.SIG_IGN]
    return handled(heard, lambda *_: os._exit(0))


@contextmanager
def handled(numbers: Iterable[signal.Signals], handler: Handler) -> Iterator[None]:
    """Signals have this handler for the length of a `with` block."""
    before = {number: signal.signal(number, handler) for number in numbers}
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, earlier)


@contextmanager
def postponed(numbers: Iterable[signal.Signals]) -> Iterator[None]:
    """Signals do what they do when a `with` block ends, not within it; those that come in a block that raises are
    forgotten."""
    heard: list[int] = []
    with handled(numbers, lambda number, _: heard.append(number)):
        yield
    for number in heard:
        signal.raise_signal(number)


accumulator, pipeline, reconstruction, replay, tracker = (partial(start, name) for name in NODES)
