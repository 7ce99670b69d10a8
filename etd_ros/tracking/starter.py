"""What starts targets without a box: clicks, and objects that move."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.tracking.auto_targets import Absences, AutoTargets, are_twins
from etd_ros.tracking.clicks import Click, Clicks
from etd_ros.tracking.discovery import Discovery, DiscoveryConfig
from etd_ros.tracking.own_targets import OwnTargets
from etd_ros.tracking.target import TargetReport


@dataclass(slots=True)
class Changes:
    """What a frame changes about the targets.

    Attributes:
        starts: names and boxes (pixels) of new ones.
        stops: names of those to forget.
        again: names and boxes (pixels) of those that were on a part of something, and go on with all of it, or whose
            box no longer fits what is seen there.
        notices: sentences about clicks that start nothing.
    """

    starts: list[tuple[str, Box]] = field(default_factory=list)
    stops: list[str] = field(default_factory=list)
    again: list[tuple[str, Box]] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)


class Starter:
    """Finds the objects of clicks, and with `auto` whatever moves, on the frames that the targets are tracked on.

    Args:
        width, height: sensor size (pixels).
        config: parameters.
        auto: whether what moves becomes a target by itself, as auto_1, auto_2, ...
    """

    def __init__(self, width: int, height: int, config: DiscoveryConfig, *, auto: bool) -> None:
        self._size = width, height
        self._config = config
        self._discovery = Discovery(width, height, config)
        self._clicks = Clicks(self._discovery)
        self._auto = AutoTargets(self._discovery, width, height) if auto else None
        self._absences = Absences()
        self._own_targets = OwnTargets()
        self._own: list[str] = []
        self._last_number = 0

    def click(self, click: Click) -> None:
        """Start the object at a point, once it is found.

        Raises:
            TrackingError: the point lies off the sensor, or the stamp is negative.
        """
        click.check(*self._size)
        self._clicks.add(click)

    @property
    def waiting_clicks(self) -> Sequence[Click]:
        """The clicks without an answer."""
        return self._clicks.waiting

    def forget(self, name: str) -> None:
        """A target is stopped, or a click taken back."""
        self._clicks.forget(name)
        self._absences.forget(name)
        self._own_targets.forget(name)
        if name in self._own:
            self._own.remove(name)

    def time_went_back(self) -> list[str]:
        """The stream starts again; the names of the targets that started by themselves, which hold no more."""
        if self._auto is not None:
            self._auto.forget()
        return list(self._own)

    def take(
        self,
        stamp_ns: int,
        frame: npt.NDArray[np.uint8],
        reports: Iterable[TargetReport],
        room: int | None = None,
    ) -> Changes:
        """Take a frame and what it brought the targets.

        Args:
            stamp_ns: T_i (ns).
            frame: uint8, shape (height, width, 2).
            reports: of the targets that there are.
            room: how many more there may be, beside the clicks that wait; None: no limit.
        """
        reports = tuple(reports)
        changes = Changes(stops=self._gone(stamp_ns, reports))
        kept = [report for report in reports if report.name not in changes.stops]
        self._discovery.take(stamp_ns, frame)
        clicks_are_due = self._clicks.are_due(stamp_ns)
        if (self._auto is None and not clicks_are_due) or not self._discovery.is_due():
            return changes
        self._discovery.look(thorough=clicks_are_due)
        changes.starts, changes.notices = self._clicks.take(stamp_ns, kept)
        if self._auto is not None:
            self._start_what_moves(self._auto, changes, kept, room)
        return changes

    def _start_what_moves(
        self, auto: AutoTargets, changes: Changes, reports: Sequence[TargetReport], room: int | None
    ) -> None:
        """Add what starts by itself, and what goes on with all of something, to a frame's changes."""
        auto.take()
        reports = self._put_right(auto, changes, reports)
        boxes = [report.box for report in reports if report.box is not None]
        boxes += [box for _, box in (*changes.again, *changes.starts)]
        own_room = self._config.max_targets - len(self._own)
        room = own_room if room is None else min(room, own_room)
        taken = {report.name for report in reports} | {click.name for click in self.waiting_clicks}
        taken |= {name for name, _ in changes.starts} | set(self._own)
        changes.starts += [(self._next_name(taken), box) for box in auto.ready(boxes, room + len(changes.stops))]

    def _put_right(
        self, auto: AutoTargets, changes: Changes, reports: Sequence[TargetReport]
    ) -> Sequence[TargetReport]:
        """Have the oldest of the targets that are parts of something go on with all of it, and stop the others; have
        those whose boxes no longer fit go on from what is seen there; the reports of the rest."""
        own = self._own_targets.take(
            self._discovery.stamp_ns, [report for report in reports if report.name in self._own]
        )
        others = [report.box for report in reports if report.box is not None and report.name not in self._own]
        others += [box for _, box in changes.starts]
        replaced: set[str] = set()
        for whole in auto.wholes(own, others):
            first, *rest = whole.names
            changes.again.append((first, whole.box))
            changes.stops += rest
            self._own_targets.begin_again(first)
            replaced.update(whole.names)
        whole_boxes = [box for _, box in changes.again]
        left = [target for target in own if target.name not in replaced]
        for name, box in auto.realigned(left, [*others, *whole_boxes]):
            changes.again.append((name, box))
            self._own_targets.begin_again(name)
            replaced.add(name)
        return [report for report in reports if report.name not in replaced]

    def _next_name(self, taken: Collection[str]) -> str:
        name = ""
        while not name or name in taken:
            self._last_number += 1
            name = f"auto_{self._last_number}"
        self._own.append(name)
        return name

    def _gone(self, stamp_ns: int, reports: tuple[TargetReport, ...]) -> list[str]:
        """Those started by themselves that were not tracked for long, or have run into a target before them."""
        gone: list[str] = []
        before: list[Box] = []
        for report in reports:
            is_gone = False
            if report.name in self._own:
                absent_s = self._absences.absent_s(report, stamp_ns)
                is_twin = report.box is not None and any(are_twins(report.box, box) for box in before)
                is_gone = is_twin or absent_s > self._config.gone_s
            if is_gone:
                gone.append(report.name)
            elif report.box is not None:
                before.append(report.box)
        return gone
