"""Threads that do a node's heavy work, fed through bounded queues."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

Handler = Callable[[bytes], None]
Task = Callable[[], None]

OVERLOAD_S = 1.0
"""So long after data was dropped (s) more is dropped early ..."""
EARLY_SHARE = 0.2
"""... when it has waited for this share of what is allowed usually."""
CATCH_UP = 2.0
"""How much faster than it comes data is passed where it has waited for twice as long."""
TASK_RATE = 0.1
"""Share of a task in how long tasks take usually."""


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
            begun_s = time.monotonic()
            try:
                waiting.task()
            except Exception as err:
                self._on_error(err)
            self._note_done(waiting, time.monotonic() - begun_s)

    def _drop_late(self) -> None:
        """Drop what is not worth doing any more; at least one task stays."""

    def _note_done(self, waiting: _Waiting, duration_s: float) -> None:
        """A task is done, and took so long (s)."""


class Worker(_TaskThread):
    """Runs handlers on messages in a thread of its own.

    The executor's thread only puts messages in, so that DDS never waits for the method. Late boxes are worth less than
    lost ones: where the work does not keep up, data is dropped and counted.

    Args:
        name: of the thread.
        max_bytes: when the queue holds more, the oldest data is dropped.
        max_age_s: data that has waited for longer (s) is dropped, and as long as that goes on the rest is thinned out
            evenly: of what comes while a message is worked on one is taken, so that a method that follows motion sees
            all of it, in many short gaps instead of a few long ones. Data is hardly late then, while a moment's
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
        self._dropped_s = -math.inf
        self._taken_s = -math.inf
        self._task_s = 0.0
        super().__init__(name, on_error)

    @property
    def queued_bytes(self) -> int:
        """Size of the messages that wait."""
        return self._queued_bytes

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
                self._drop(next((waiting for waiting in self._queue if waiting.is_data), self._queue[0]))
            self._changed.notify_all()

    def _drop_late(self) -> None:
        oldest = next((waiting for waiting in self._queue if waiting.is_data), None)
        if oldest is None:
            return
        now_s = time.monotonic()
        age_s, early_s = now_s - oldest.received_s, EARLY_SHARE * self.max_age_s
        if age_s > self.max_age_s or now_s - self._dropped_s <= OVERLOAD_S:
            pace = min(CATCH_UP, age_s / early_s) if early_s else CATCH_UP
            self._drop_before(max(now_s - self.max_age_s, self._taken_s + pace * self._task_s), now_s)

    def _drop_before(self, received_s: float, now_s: float) -> None:
        """Drop data that came before a time (s), but for the newest."""
        data = [waiting for waiting in self._queue if waiting.is_data]
        for waiting in data[:-1]:
            if waiting.received_s >= received_s:
                return
            self._drop(waiting)
            self._dropped_s = now_s

    def _note_done(self, waiting: _Waiting, duration_s: float) -> None:
        if waiting.is_data:
            self._taken_s = waiting.received_s
            self._task_s += TASK_RATE * (duration_s - self._task_s)

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
