"""Threads that do a node's heavy work, fed through bounded queues."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

Handler = Callable[[bytes], None]
Task = Callable[[], None]

KEPT_SHARE = 0.5
"""What is older than this share of what is allowed goes with the oldest: rarer gaps, none of them long."""
EARLY_SHARE = 0.25
"""The work keeps up as long as nothing has waited for more than this share of what is allowed."""
PATIENCE_FACTOR, PATIENCE_MIN, OVERLOAD_S = 0.8, 0.4, 1.0
"""Each time that data is dropped, this share of the age that was allowed is allowed from then on, down to the second
share of what is allowed usually; without a drop for this time (s) all of it is again."""


@dataclass(slots=True)
class WorkerCounters:
    """What had to be dropped because the work did not keep up."""

    dropped_messages: int = 0
    dropped_bytes: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class _Waiting:
    """A task in a queue; `received_s` is when it came (s, monotonic)."""

    task: Task
    size: int = 0
    received_s: float = 0.0
    is_data: bool = False


class _TaskThread:
    """Runs tasks, one at a time and in order; subclasses decide what waits."""

    def __init__(self, name: str, on_error: Callable[[Exception], None]) -> None:
        self._on_error = on_error
        self._queue: deque[_Waiting] = deque()
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
                self._drop_late()
                waiting = self._queue.popleft()
                self._queued_bytes -= waiting.size
                self._changed.notify_all()
            try:
                waiting.task()
            except Exception as err:
                self._on_error(err)

    def _drop_late(self) -> None:
        """Drop what is not worth doing any more; at least one task stays."""


class Worker(_TaskThread):
    """Runs handlers on messages in a thread of its own.

    The executor's thread only puts messages in, so that DDS never waits for the method. Late boxes are worth less than
    lost ones: where the work does not keep up, data is dropped and counted.

    Args:
        name: of the thread.
        max_bytes: when the queue holds more, the oldest data is dropped.
        max_age_s: when the oldest data has waited for longer (s), the older half is dropped: what is worked on between
            two such moments is without gaps, which a method that follows motion needs more than an even share. What
            cannot keep up for long comes to drop earlier, so that it is late as little as it can, while a moment's
            hesitation loses nothing.
        on_error: called with what a handler raises.
        counters: of what is dropped.
    """

    def __init__(
        self,
        name: str,
        max_bytes: int,
        max_age_s: float,
        on_error: Callable[[Exception], None],
        counters: WorkerCounters | None = None,
    ) -> None:
        self.counters = counters or WorkerCounters()
        self.max_bytes = max_bytes
        self.max_age_s = max_age_s
        self._patience = 1.0
        self._dropped_s = 0.0
        super().__init__(name, on_error)

    @property
    def queued_bytes(self) -> int:
        """Size of the messages that wait."""
        return self._queued_bytes

    @property
    def keeps_up(self) -> bool:
        """Whether no data has waited for long."""
        with self._changed:
            oldest = self._oldest_data()
        return oldest is None or time.monotonic() - oldest.received_s <= EARLY_SHARE * self.max_age_s

    def submit(self, handler: Handler, message: bytes) -> None:
        """Have `handler(message)` called in the worker's thread, unless it is dropped as too old before."""
        self._put(handler, message, is_data=True)

    def submit_request(self, handler: Handler, message: bytes = b"") -> None:
        """The same for what is not sent again and again, such as a target: data is dropped before it."""
        self._put(handler, message, is_data=False)

    def _put(self, handler: Handler, message: bytes, *, is_data: bool) -> None:
        with self._changed:
            self._queue.append(_Waiting(lambda: handler(message), len(message), time.monotonic(), is_data))
            self._queued_bytes += len(message)
            while self._queued_bytes > self.max_bytes and len(self._queue) > 1:
                self._drop(self._oldest_data() or self._queue[0])
            self._changed.notify_all()

    def _drop_late(self) -> None:
        oldest = self._oldest_data()
        now_s = time.monotonic()
        if now_s - self._dropped_s > OVERLOAD_S:
            self._patience = 1.0
        allowed_s = self._patience * self.max_age_s
        if oldest is None or now_s - oldest.received_s <= allowed_s:
            return
        self._patience, self._dropped_s = max(PATIENCE_MIN, PATIENCE_FACTOR * self._patience), now_s
        data = [waiting for waiting in self._queue if waiting.is_data]
        for waiting in data[:-1]:
            if now_s - waiting.received_s > KEPT_SHARE * allowed_s:
                self._drop(waiting)

    def _oldest_data(self) -> _Waiting | None:
        return next((waiting for waiting in self._queue if waiting.is_data), None)

    def _drop(self, waiting: _Waiting) -> None:
        self._queue.remove(waiting)
        self._queued_bytes -= waiting.size
        self.counters.dropped_messages += 1
        self.counters.dropped_bytes += waiting.size


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
            self._queue.append(_Waiting(task))
            self._changed.notify_all()
