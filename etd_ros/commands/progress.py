"""A progress line on standard error, only where somebody watches."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from etd_ros.stream import StreamBatch


@contextmanager
def with_progress(batches: Iterable[StreamBatch], verb: str) -> Iterator[Iterator[StreamBatch]]:
    """The same batches, counted on a progress line while they are taken."""
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(verb)

        def counted() -> Iterator[StreamBatch]:
            events, first_ns = 0, None
            for batch in batches:
                times = batch.events.t
                first_ns = int(times[0]) if first_ns is None else first_ns
                events += len(times)
                seconds = (int(times[-1]) - first_ns) / 1e9
                progress.update(task, description=f"{verb}: {events / 1e6:.2f} M events, {seconds:.1f} s recorded")
                yield batch

        yield counted()
