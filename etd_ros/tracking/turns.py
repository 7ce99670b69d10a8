"""How often each of many targets is looked at, and which of them are looked for on an image: many together cost little
more than few."""

from __future__ import annotations

WATCH_NS = 1_990_000_000
"""From one look for what has drifted to the next, of whichever target: with one image in 50 ms every fortieth. A node
does not wait for the search, but shares the interpreter's lock and the cores with it, and is slower by some
milliseconds meanwhile: seldom enough that less than one message in a hundred meets it."""
SEARCHES_MAX = 2
"""So many lost targets are looked for on an image: a search takes 10 ms of a core, and an image comes in 50 ms."""
IMAGE_NS = 50_000_000
"""From one image to the next, usually."""
FEW, MORE, PATIENCE_MAX = 8, 6, 3.0
"""So many targets are looked at as often as one alone; for so many more each waits as long once more, up to so many
times as long."""


class Turns:
    """Of all targets: those that are followed are looked for elsewhere one at a time, all in turn, so that many cost no
    more than one; of those that are lost, each is looked for the less often the more there are.

    Attributes:
        patience: how many times as long as one alone each target waits for the next look at its contours.
    """

    def __init__(self) -> None:
        self.patience = 1.0
        self._stamp_ns = 0
        self._given_ns: int | None = None
        self._given = self._asking = 0
        self._count = 1
        self._lost_stamp_ns = 0
        self._lost = self._lost_before = 0.0

    def share_among(self, targets: int) -> None:
        """There are so many targets now."""
        self.patience = min(1.0 + max(targets - FEW, 0) / MORE, PATIENCE_MAX)

    @property
    def are_many(self) -> bool:
        """Whether there are more targets than can be looked at as often as one alone."""
        return self.patience > 1

    def take(self, stamp_ns: int, last: int | None) -> int | None:
        """The number of the turn if the image at `stamp_ns` (ns) is for the followed target that asks, else None.

        Args:
            stamp_ns: of the image.
            last: the number of the turn that this target had last, None before the first.
        """
        if stamp_ns != self._stamp_ns:
            self._stamp_ns = stamp_ns
            self._count, self._asking = max(1, self._asking), 0
        self._asking += 1
        is_too_soon = self._given_ns is not None and 0 <= stamp_ns - self._given_ns < WATCH_NS
        if is_too_soon or (last is not None and self._given + 1 - last < self._count):
            return None
        self._given_ns = stamp_ns
        self._given += 1
        return self._given

    def wait_ns(self, stamp_ns: int, images: int) -> int:
        """How long after the last search for the lost target that asks the image at `stamp_ns` (ns) may be searched for
        it: every one of so many images, or fewer where too many targets are lost. Each asks once an image."""
        if stamp_ns != self._lost_stamp_ns:
            self._lost_stamp_ns = stamp_ns
            self._lost_before, self._lost = self._lost, 0.0
        self._lost += 1 / images
        fewer = max(1.0, self._lost_before / SEARCHES_MAX)
        return round((images * fewer - 0.5) * IMAGE_NS)
