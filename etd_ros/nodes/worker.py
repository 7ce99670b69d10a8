"""Threads that do a node's heavy work, fed through bounded queues."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

Handler = Callable[[bytes], None]
Task = Callable[[], None]


@dataclass(slots=True)
class WorkerCounters:
    """What had to be dropped because the work did not keep up."""

    dropped_messages: int = 0
    dropped_bytes: int = 0


class _TaskThread:
    """Runs tasks, one at a time and in order; subclasses decide what waits."""

    def __init__(self, name: str, on_error: Callable[[Exception], None]) -> None:
        self._on_error = on_error
        self._queue: deque[tuple[Task, int]] = deque()
        self._queued_bytes = 0
        self._stopping = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Drop what waits, let the task at work finish, and end the thread."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._stopping or self._queue)
                if self._stopping:
                    return
                task, size = self._queue.popleft()
                self._queued_bytes -= size
                self._changed.notify_all()
            try:
                task()
            except Exception as err:
                self._on_error(err)


class Worker(_TaskThread):
    """Runs handlers on messages in a thread of its own.

    The executor's thread only puts messages in, so that DDS never waits for the method. When the queue holds
    more than `max_bytes`, the oldest messages are dropped and counted: late boxes are worth less than lost ones.
    """

    def __init__(self, name: str, max_bytes: int, on_error: Callable[[Exception], None]) -> None:
        self.counters = WorkerCounters()
        self._max_bytes = max_bytes
        super().__init__(name, on_error)

    @property
    def queued_bytes(self) -> int:
        """Size of the messages that wait."""
        return self._queued_bytes

    def submit(self, handler: Handler, message: bytes) -> None:
        """Have `handler(message)` called in the worker's thread."""
        with self._changed:
            self._queue.append((lambda: handler(message), len(message)))
            self._queued_bytes += len(message)
            while self._queued_bytes > self._max_bytes and len(self._queue) > 1:
                _, dropped_bytes = self._queue.popleft()
                self._queued_bytes -= dropped_bytes
                self.counters.dropped_messages += 1
                self.counters.dropped_bytes += dropped_bytes
            self._changed.notify_all()


class Inline:
    """A later stage without a thread of its own: a task has been done when `submit` returns."""

    def __init__(self, on_error: Callable[[Exception], None]) -> None:
        self._on_error = on_error

    def submit(self, task: Task) -> None:
        """Do the task."""
        try:
            task()
        except Exception as err:
            self._on_error(err)

    def stop(self) -> None:
        """Nothing is under way."""


class Relay(_TaskThread):
    """A later stage's thread. An earlier stage that is too fast waits; nothing on the way between two is dropped.

    So the queue of messages at the node's input is the only place where a slow node loses any.
    """

    def __init__(self, name: str, depth: int, on_error: Callable[[Exception], None]) -> None:
        self._depth = depth
        super().__init__(name, on_error)

    def submit(self, task: Task) -> None:
        """Have the task run in the relay's thread; return once fewer than `depth` wait, or the relay is stopped."""
        with self._changed:
            self._changed.wait_for(lambda: self._stopping or len(self._queue) < self._depth)
            self._queue.append((task, 0))
            self._changed.notify_all()
