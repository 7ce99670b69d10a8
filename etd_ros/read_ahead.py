"""Work beside work: an iterator that runs ahead in a thread of its own."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Generator, Iterable
from typing import Generic, TypeVar

T = TypeVar("T")

ITEMS_AHEAD = 8
"""Enough that neither side waits for the other's odd slow item, and few enough to hold in memory."""


def read_ahead(items: Iterable[T], depth: int = ITEMS_AHEAD) -> Generator[T, None, None]:
    """The same items in the same order, made in a thread while the caller works on earlier ones.

    The thread starts with the first item asked for and has ended when this generator has: exhausted, failed or closed
    (dropping the last reference closes it). A chain of these closes from its end to its source.

    Args:
        items: what is read; its own error is raised here after the items before it. Where it has `close`, as
            generators have, that is called in the thread when the reading ends.
        depth: most items that wait for the caller.
    """
    channel = _Channel[T](depth)
    thread = threading.Thread(target=_fill, args=(channel, items), name="read_ahead", daemon=True)
    thread.start()
    try:
        yield from channel
    finally:
        channel.close()
        thread.join()
    if channel.error is not None:
        raise channel.error


class _Channel(Generic[T]):
    """A bounded queue from one thread to another that either side can end."""

    def __init__(self, depth: int) -> None:
        self.error: BaseException | None = None
        """What ended the writer's work, set before `close`."""
        self._depth = depth
        self._items: deque[T] = deque()
        self._is_closed = False
        self._changed = threading.Condition()

    def put(self, item: T) -> bool:
        """Add an item as soon as there is room; False where nobody wants it any more."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or len(self._items) < self._depth)
            if self._is_closed:
                return False
            self._items.append(item)
            self._changed.notify()
            return True

    def close(self) -> None:
        """End the queue: nothing is added any more."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()

    def __iter__(self) -> Generator[T, None, None]:
        """The items until the queue is closed and empty."""
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._is_closed or self._items)
                if not self._items:
                    return
                item = self._items.popleft()
                self._changed.notify()
            yield item


def _fill(channel: _Channel[T], items: Iterable[T]) -> None:
    try:
        iterator = iter(items)
        try:
            for item in iterator:
                if not channel.put(item):
                    break
        finally:
            if isinstance(iterator, Generator):
                iterator.close()
    # Whatever it is, it belongs to the thread that asked for the items.
    except BaseException as err:
        channel.error = err
    finally:
        channel.close()
