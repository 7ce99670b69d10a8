"""What is said on standard error while a command works, only where somebody watches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext
from itertools import count
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from etd_ros.compile_notice import compile_notice
from etd_ros.recordings.interface import RecordedImage
from etd_ros.stream import StreamBatch

NS_PER_S = 1e9
Item = TypeVar("Item")
Extent = tuple[str, int, int]
"""How much was taken so far, in words; the last item's first and last time (ns)."""


@contextmanager
def with_progress(batches: Iterable[StreamBatch], verb: str) -> Iterator[Iterator[StreamBatch]]:
    """The same batches, counted on a progress line while they are taken."""
    events = 0

    def extent(batch: StreamBatch) -> Extent:
        nonlocal events
        times_ns = batch.events.t
        events += len(times_ns)
        return f"{events / 1e6:.2f} M events", int(times_ns[0]), int(times_ns[-1])

    with _line(verb) as show:
        yield _counted(batches, extent, show)


@contextmanager
def with_image_progress(images: Iterable[RecordedImage], verb: str) -> Iterator[Iterator[RecordedImage]]:
    """The same video frames, counted on a progress line while they are taken."""
    numbers = count(1)

    def extent(image: RecordedImage) -> Extent:
        return f"{next(numbers)} video frames", image.stamp_ns, image.stamp_ns

    with _line(verb) as show:
        yield _counted(images, extent, show)


@contextmanager
def with_compile_notice() -> Iterator[None]:
    """Say once that kernels are being compiled, which holds up the first run on a machine."""
    console = Console(stderr=True)
    text = "Compiling for this machine, which takes up to two minutes; the next run finds it done"
    with compile_notice(lambda: console.print(text)) if console.is_terminal else nullcontext():
        yield


@contextmanager
def _line(verb: str) -> Iterator[Callable[[str], None]]:
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(verb)
        yield lambda text: progress.update(task, description=f"{verb}: {text}")


def _counted(items: Iterable[Item], extent: Callable[[Item], Extent], show: Callable[[str], None]) -> Iterator[Item]:
    start_ns = None
    for item in items:
        taken, first_ns, last_ns = extent(item)
        start_ns = first_ns if start_ns is None else start_ns
        show(f"{taken}, {(last_ns - start_ns) / NS_PER_S:.1f} s recorded")
        yield item
