"""Images at stamps that become known after their events, or before them."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from etd_ros.events import Events
from etd_ros.reconstruction.high_pass import HighPassFilter, ReconstructionError

HELD_BYTES_MAX = 64 << 20
BATCH_BYTES = 1024
"""What a batch takes beside its events, for its objects."""
PINNED_MAX = 2
"""A batch that lies in arrays so many times as large, which it keeps from being used again, is copied to be held."""
REQUESTS_MAX = 1 << 16
REQUESTS_AHEAD_MAX = 8


class SynchronisedReconstruction:
    """Events and stamps in, in any interleaving; images out, in the order of the stamps.

    The image at stamp T holds the events with t < T. It is complete once an event with t >= T has been seen,
    so an engine that knows events and stamps at once and a node that gets them on two topics yield the same images.
    Events are held back until a stamp is known; `held_bytes_max` bounds that, the oldest events being
    integrated early.

    A stamp below the last one asked for is the first of a new stream (a bag loops): the stamps that still wait are
    given up. On two topics the stamps may step back before the events do; then the new ones wait for `reset`, so that
    no image of the old stream goes out under them. Neither a stamp of the old stream that comes after the reset nor a
    reset that never comes stops the images for longer than a few stamps.

    Attributes:
        integrated_early: number of events integrated before a stamp was known, because the bound was reached.
        requests_dropped: number of stamps given up because too many waited for events, or time went back.
    """

    def __init__(self, high_pass: HighPassFilter, *, held_bytes_max: int = HELD_BYTES_MAX) -> None:
        self._filter = high_pass
        self._held_bytes_max = held_bytes_max
        self.integrated_early = 0
        self.requests_dropped = 0
        self._held: deque[Events] = deque()
        self._held_bytes = 0
        self._requests: deque[int] = deque()
        self._last_request_ns: int | None = None
        self._is_ahead_of_reset = False
        self._seen_ns: int | None = None

    @property
    def held_bytes(self) -> int:
        """Bytes of the batches held back."""
        return self._held_bytes

    def push(self, events: Events) -> None:
        """Take a batch that follows the last one in time. Its arrays are kept, and not copied unless they are a small
        part of larger ones.

        Raises:
            ReconstructionError: the batch is of another sensor size.
        """
        if (events.width, events.height) != (self._filter.width, self._filter.height):
            msg = (
                f"events of a {events.width}x{events.height} sensor for a reconstruction of "
                f"{self._filter.width}x{self._filter.height}: make a new one when the sensor changes"
            )
            raise ReconstructionError(msg)
        if not len(events):
            return
        self._hold(events)
        self._seen_ns = int(events.t[-1])
        while self._held_bytes > self._held_bytes_max and not self._is_using_held():
            self.integrated_early += len(self._held[0])
            self._integrate_first(len(self._held[0]))

    def request(self, stamp_ns: int) -> None:
        """Ask for the image at a stamp (ns)."""
        if self._last_request_ns is not None and stamp_ns < self._last_request_ns:
            # A stamp that still waits is one of the old stream that came after the reset: no other reset will come.
            self._is_ahead_of_reset = self._is_ahead_of_reset or not self._requests
            self._drop_requests()
        self._last_request_ns = stamp_ns
        self._requests.append(stamp_ns)
        if len(self._requests) > REQUESTS_MAX:
            self._requests.popleft()
            self.requests_dropped += 1
        if len(self._requests) > REQUESTS_AHEAD_MAX:
            self._is_ahead_of_reset = False

    def pass_by(self, stamp_ns: int) -> None:
        """There is no image at this stamp (ns), which follows the last one asked for: what came before it is integrated
        now, so that the next image does not wait for all of it. Call it where events and stamps are known at once."""
        self._integrate_before(stamp_ns)

    def ready(self) -> Iterator[tuple[int, npt.NDArray[np.uint8]]]:
        """The (stamp, image) pairs asked for whose events have all been seen; images are uint8, shape (h, w)."""
        while self._requests and not self._is_ahead_of_reset:
            stamp_ns = self._requests[0]
            self._integrate_before(stamp_ns)
            if self._seen_ns is None or self._seen_ns < stamp_ns:
                return
            self._requests.popleft()
            yield stamp_ns, self._filter.image(stamp_ns)

    def reset(self) -> None:
        """Forget events, stamps and the filter's state: the next events start a new stream.

        Stamps that have stepped back already are the new stream's, and stay.
        """
        self._held.clear()
        self._held_bytes = 0
        if not self._is_ahead_of_reset:
            self._drop_requests()
            self._last_request_ns = None
        self._is_ahead_of_reset = False
        self._seen_ns = None
        self._filter.reset()

    def _drop_requests(self) -> None:
        self.requests_dropped += len(self._requests)
        self._requests.clear()

    def _hold(self, events: Events) -> None:
        if _pinned_bytes(events) >= PINNED_MAX * _event_bytes(events):
            t, x, y, p = events.t.copy(), events.x.copy(), events.y.copy(), events.p.copy()
            events = Events(t, x, y, p, events.width, events.height)
        self._held.append(events)
        self._held_bytes += BATCH_BYTES + _event_bytes(events)

    def _is_using_held(self) -> bool:
        """Whether `ready` integrates the oldest events, since a stamp after them waits."""
        return bool(self._requests) and not self._is_ahead_of_reset and self._requests[0] > self._held[0].t[0]

    def _integrate_before(self, stamp_ns: int) -> None:
        while self._held:
            count = int(np.searchsorted(self._held[0].t, stamp_ns))
            whole = count == len(self._held[0])
            self._integrate_first(count)
            if not whole:
                return

    def _integrate_first(self, count: int) -> None:
        """Integrate the first `count` events of the oldest batch and let go of them."""
        batch = self._held.popleft()
        self._filter.integrate(batch[:count])
        self._held_bytes -= _event_bytes(batch[:count])
        if count < len(batch):
            self._held.appendleft(batch[count:])
        else:
            self._held_bytes -= BATCH_BYTES


def _event_bytes(events: Events) -> int:
    return events.t.nbytes + events.x.nbytes + events.y.nbytes + events.p.nbytes


def _pinned_bytes(events: Events) -> int:
    """Bytes of the arrays that a batch's own are views of, which may have one block in common."""
    views: list[npt.NDArray[np.generic]] = [events.t, events.x, events.y, events.p]
    blocks = [view.base if isinstance(view.base, np.ndarray) else view for view in views]
    return sum({id(block): block.nbytes for block in blocks}.values())
