"""One thread that does a node's heavy work, fed through a queue that is bounded in bytes."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

Handler = Callable[[bytes], None]


@dataclass(slots=True)
class WorkerCounters:
    """What had to be dropped because the work did not keep up."""

    dropped_messages: int = 0
    dropped_bytes: int = 0


class Worker:
    """Runs handlers on messages, one at a time and in order, in a thread of its own.

    The executor's thread only puts messages in, so that DDS never waits for the method. When the queue holds
    more than `max_bytes`, the oldest messages are dropped and counted: late boxes are worth less than lost ones.
    """

    def __init__(self, name: str, max_bytes: int, on_error: Callable[[Exception], None]) -> None:
        self.counters = WorkerCounters()
        self._max_bytes = max_bytes
        self._on_error = on_error
        self._queue: deque[tuple[Handler, bytes]] = deque()
        self._queued_bytes = 0
        self._stopping = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    @property
    def queued_bytes(self) -> int:
        """Size of the messages that wait."""
        return self._queued_bytes

    def submit(self, handler: Handler, message: bytes) -> None:
        """Have `handler(message)` called in the worker's thread."""
        with self._changed:
            self._queue.append((handler, message))
            self._queued_bytes += len(message)
            while self._queued_bytes > self._max_bytes and len(self._queue) > 1:
                _, dropped = self._queue.popleft()
                self._queued_bytes -= len(dropped)
                self.counters.dropped_messages += 1
                self.counters.dropped_bytes += len(dropped)
            self._changed.notify()

    def stop(self) -> None:
        """Drop what waits, let the message at work finish, and end the thread."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopping or self._queue)
                if self._stopping:
                    return
                handler, message = self._queue.popleft()
                self._queued_bytes -= len(message)
            try:
                handler(message)
            except Exception as err:
                self._on_error(err)
