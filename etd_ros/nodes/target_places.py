"""Who is followed: the targets that were asked for, those that wait for the next frame, what they are called, and who
makes room for whom."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

from etd_ros.nodes.target_limits import LostTimes
from etd_ros.targets import TargetStart
from etd_ros.tracking import Click, MultiTracker, TargetReport
from msg_adapters import Detection


class TargetPlaces:
    """The targets that a node follows or will follow, by name.

    Args:
        configured: those of the parameters, which make room for none.

    Attributes:
        targets: those that were asked for by a box, and where they start again.
        new: those that start, or start again, with the next frame.
        stopped: those that stop with it.
        clicks: those that are looked for from it on.
        in_tracker: the names of all that the tracker follows, and of clicks that wait in it.
        has_begun: whether there was a tracker.
    """

    def __init__(self, configured: Iterable[TargetStart]) -> None:
        self.targets = {target.name: target for target in configured}
        self.new: dict[str, TargetStart] = {}
        self.stopped: set[str] = set()
        self.clicks: list[Click] = []
        self.in_tracker: set[str] = set()
        self.has_begun = False
        self._configured = set(self.targets)
        self._followed = 0
        self._lost = LostTimes()
        self._numbers = {"target": 0, "point": 0}

    def __len__(self) -> int:
        """How many are followed, or will be from the first frame on."""
        return self._followed if self.has_begun else len(self.targets | self.new)

    @property
    def has_any(self) -> bool:
        """Whether anybody is followed, or waits to be. Any thread may ask."""
        return bool(self.targets or self.new or self.clicks or self.in_tracker)

    def begin(self) -> set[str]:
        """For a new tracker: the new targets start with all others. Returns their names."""
        new = set(self.new)
        self.targets |= self.new
        self.new.clear()
        self.stopped.clear()
        self.in_tracker.clear()
        self._lost = LostTimes()
        return new

    def taken(self) -> None:
        """The tracker has what is new."""
        self.stopped.clear()
        self.new.clear()
        self.clicks.clear()

    def note(self, stamp_ns: int, tracker: MultiTracker, reports: Iterable[TargetReport]) -> None:
        """Who is followed after a frame (ns), and who is lost."""
        self._lost.note(stamp_ns, reports)
        self.in_tracker = {*tracker.targets, *tracker.waiting_clicks}
        self._followed = len(tracker.targets)

    def stop(self, name: str) -> None:
        """Follow a target no longer."""
        if name in self.in_tracker or name in self.targets:
            self.stopped.add(name)
        self.forget(name)
        self.new.pop(name, None)
        self.in_tracker.discard(name)
        self.clicks = [click for click in self.clicks if click.name != name]

    def forget(self, name: str) -> None:
        """Do not start a target again."""
        self.targets.pop(name, None)
        self._configured.discard(name)

    def class_of(self, name: str) -> str:
        """What a target was said to be, which a box without a class leaves as it was; "" if it was never said."""
        known = self.new.get(name) or self.targets.get(name)
        return known.class_id if known else ""

    def held(self) -> set[str]:
        """The names of all that are followed, or wait to be."""
        return {*self.targets, *self.new, *self.in_tracker, *(click.name for click in self.clicks)}

    def leaving(self, kept: set[str]) -> Iterator[str]:
        """Who makes room for new ones, in this order: those that no sensor holds, and those that are lost for long."""
        waiting = [name for name in self.targets if self.has_begun and name not in self.in_tracker]
        kept = {*kept, *self._configured, *self.new}
        return iter([name for name in (*waiting, *self._lost.long_lost()) if name not in kept])

    def next_name(self, kind: str, held: set[str]) -> str:
        """A name for what came without one."""
        name = ""
        while not name or name in held:
            self._numbers[kind] += 1
            name = f"{kind}_{self._numbers[kind]}"
        return name


def names_of(detections: Sequence[Detection]) -> list[str]:
    """What the boxes of a message are called: by their id, else by their class, and numbered from its second one on
    (person, person_2, ...), so that two boxes are two targets; "" where a box has neither."""
    taken = {detection.id for detection in detections}
    numbered: dict[str, Iterator[str]] = {}
    names = []
    for detection in detections:
        name = detection.id
        if not name and detection.class_id:
            candidates = numbered.setdefault(detection.class_id, _numbered(detection.class_id))
            name = next(candidate for candidate in candidates if candidate not in taken)
            taken.add(name)
        names.append(name)
    return names


def first_of_each(starts: Sequence[TargetStart]) -> tuple[list[TargetStart], list[str]]:
    """The first box of each name in a message, and all that have none; the names of those that come again with another
    box, which may be of other objects."""
    firsts: dict[str, TargetStart] = {}
    kept, repeated = [], []
    for start in starts:
        first = firsts.setdefault(start.name, start) if start.name else start
        if first is start:
            kept.append(start)
        elif first != start:
            repeated.append(start.name)
    return kept, repeated


def _numbered(class_id: str) -> Iterator[str]:
    yield class_id
    yield from (f"{class_id}_{number}" for number in itertools.count(2))
