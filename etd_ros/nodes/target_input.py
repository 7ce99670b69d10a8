"""Targets in: those of the parameters, boxes and clicks, and what becomes of them from sensor to sensor."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from geometry_msgs.msg import PointStamped
from vision_msgs.msg import Detection2DArray

from etd_ros.boxes import OffSensorError
from etd_ros.errors import EtdError
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.remarks import REMARKS_PERIOD_S
from etd_ros.nodes.target_limits import (
    START_AHEAD_MAX_S,
    START_LATE_MAX_S,
    EventClock,
    Refusals,
    named,
)
from etd_ros.nodes.target_memory import Remembered, TargetMemory
from etd_ros.nodes.target_places import TargetPlaces, first_of_each, names_of
from etd_ros.nodes.target_topics import TrackingOptions
from etd_ros.nodes.worker import Task
from etd_ros.targets import TargetError, TargetStart, targets_from_file, targets_from_text, unique_targets
from etd_ros.tracking import Click, MultiTracker, TargetReport, check_target
from msg_adapters import DetectionsMessage, PointMessage, decode_detections, decode_point

MEMORY_PERIOD_S, REST_PERIOD_S = 0.2, 0.5
SENSORS_SAID_MAX = 16
"""Sensor sizes of which it is said which targets they do not hold: more than these are nobody's cameras."""


class TargetInput:
    """The targets that were asked for: by parameters, by boxes on `~/targets`, and by clicks on `~/clicked_point`.

    A box of width and height 0 stops the target of its id. All that are followed, those that start by themselves among
    them, are `targets_max` at most: beyond it what is new is refused, unless a target that is lost for long, and not of
    the parameters, makes room. A target whose box the sensor does not hold waits for one that does.

    Args:
        node: whose parameters and topic they are.
        submit: runs a task in the tracker's thread, where the targets are started; by default that is the worker's.

    Raises:
        EtdError: the targets of the parameters, or the memory's file, cannot be read, or are more than `targets_max`.
    """

    def __init__(self, node: EtdNode, submit: Callable[[Task], None] = lambda task: task()) -> None:
        self._node = node
        self._submit = submit
        memory_file, targets_file = _path(node.options.memory_file), _path(node.options.targets_file)
        self._memory = TargetMemory(memory_file, filter(None, [targets_file]), node.get_logger().warning)
        self._places = TargetPlaces(_from_options(node.options))
        self._clock = EventClock()
        self._refusals = Refusals(node)
        self._off_said: dict[tuple[int, int], set[str]] = {}

    def __len__(self) -> int:
        """How many are followed, or will be from the first frame on."""
        return len(self._places)

    def class_of(self, name: str) -> str:
        """What a target was said to be; "" if nobody said."""
        return self._places.class_of(name)

    def open(self) -> None:
        """Listen."""
        self._node.reader(Detection2DArray, "~/targets", self._receive)
        self._node.reader(PointStamped, "~/clicked_point", self._receive_point)
        self._node.every(MEMORY_PERIOD_S, self._remember)
        self._node.every(REST_PERIOD_S, self._refusals.say_rest)

    def missing(self) -> list[str]:
        """What is missing where there is nothing to track, in a sentence."""
        if self._places.has_any or self._node.options.auto:
            return []
        boxes, points = (self._node.resolve_topic_name(topic) for topic in ("~/targets", "~/clicked_point"))
        return [
            f"waiting for targets on {boxes} (vision_msgs/msg/Detection2DArray, reliable): publish boxes there or "
            f"points on {points}, or set the parameter targets, targets_file or auto"
        ]

    # --- what the tracker's thread calls, frame by frame

    def start_all(self, tracker: MultiTracker, stamp_ns: int, first_ns: int) -> None:
        """Start every target on a new tracker: at its box, or where the node's last life has left it.

        Args:
            tracker: the new tracker.
            stamp_ns: of its first frame (ns).
            first_ns: earliest time (ns) that the first data may be of. Targets that start before it are counted as
                errors when the node begins; they are tracked from the next frame on.
        """
        self._hold_against(stamp_ns)
        places = self._places
        asked_for = places.begin()
        taken_back = {} if places.has_begun else self._take_back(stamp_ns, asked_for)
        off_sensor = {}
        for target in tuple(places.targets.values()):
            start = taken_back.get(target.name, target)
            if start is None:
                continue
            err = _started(tracker, start)
            if err is not None and start is not target:
                err = _started(tracker, target)
            if isinstance(err, OffSensorError):
                off_sensor[target.name] = err
            elif err is not None:
                places.forget(target.name)
                self._refusals.note("box", str(err))
            if not places.has_begun and target.name not in taken_back:
                self._check_start(target, first_ns)
        self._say_off_sensor(tracker.size, off_sensor)
        places.has_begun = True

    def start_new(self, tracker: MultiTracker, stamp_ns: int) -> None:
        """Stop, start, or start again the targets that came since the last call; the stamp (ns) is the next frame's."""
        places = self._places
        self._hold_against(stamp_ns)
        self._say_late(stamp_ns)
        tracker.targets_max = self._node.options.targets_max
        for name in places.stopped & {*tracker.targets, *tracker.waiting_clicks}:
            tracker.stop(name)
        for target in places.new.values():
            err = _started(tracker, target)
            is_followed = target.name in tracker.targets
            if err is None or (isinstance(err, OffSensorError) and not is_followed):
                places.targets[target.name] = target
            if err is not None:
                then = "what is followed under this name goes on" if is_followed else "kept for one that holds it"
                self._refusals.note("box", f"{err}; {then}" if isinstance(err, OffSensorError) else str(err))
        for click in places.clicks:
            try:
                tracker.click(click)
            except EtdError as err:
                self._refusals.note("click", str(err))
        places.taken()

    def note(self, stamp_ns: int, tracker: MultiTracker, reports: tuple[TargetReport, ...]) -> None:
        """What a frame brought: remembered, and said in the log where clicks start nothing."""
        self._memory.note(stamp_ns, reports, self._places.class_of)
        for notice in tracker.take_notices():
            self._node.warn(notice)
        self._places.note(stamp_ns, tracker, reports)

    def _take_back(self, stamp_ns: int, asked_for: set[str]) -> dict[str, TargetStart | None]:
        """The targets as the memory has them, as far as there is room; None for those that were lost. Those that have a
        new box already are left out."""
        starts: dict[str, TargetStart | None] = {}
        for target in self._memory.recall(stamp_ns):
            self._know_class(target)
            if target.name in asked_for:
                continue
            if target.was_lost:
                self._node.get_logger().warning(f"{target.name} was lost before the restart: give it a new box")
                starts[target.name] = None
            elif target.name in self._places.targets or len(self._places.targets) < self._node.options.targets_max:
                class_id = self._places.class_of(target.name) or target.class_id
                starts[target.name] = start = TargetStart(target.name, target.box, class_id=class_id)
                self._places.targets.setdefault(target.name, start)
                self._node.get_logger().info(f"{target.name} is taken back after {target.age_s:.1f} s")
            else:
                self._refuse_for_room([target.name])
        return starts

    def _know_class(self, remembered: Remembered) -> None:
        """What is asked for again without a class is what it was before."""
        asked_for = self._places.targets.get(remembered.name)
        if asked_for is not None and not asked_for.class_id:
            self._places.targets[remembered.name] = dataclasses.replace(asked_for, class_id=remembered.class_id)

    def _say_off_sensor(self, size: tuple[int, int], refused: dict[str, OffSensorError]) -> None:
        """Count and say once for each sensor which targets it does not hold."""
        said = self._off_said.get(size, set())
        new = [name for name in refused if name not in said]
        if not new:
            return
        others = f". So do {named(new[1:])}" if new[1:] else ""
        text = (
            f"{refused[new[0]]}{others}. What is off the sensor is kept, and starts at its box once a sensor holds it"
        )
        if size in self._off_said or len(self._off_said) < SENSORS_SAID_MAX:
            self._off_said[size] = set(refused)
            self._refusals.say(text, len(new))
        else:
            self._refusals.note("sensor", text, len(new))

    def _check_start(self, target: TargetStart, first_ns: int) -> None:
        try:
            target.check_start(first_ns)
        except TargetError as err:
            self._refusals.note("early", str(err))

    # --- what comes

    def _receive(self, message: bytes) -> None:
        self._node.worker.submit_request(self._decode, message)

    def _decode(self, message: bytes) -> None:
        decoded = decode_detections(message)
        self._submit(lambda: self._take(decoded))

    def _receive_point(self, message: bytes) -> None:
        self._node.worker.submit_request(self._decode_point, message)

    def _decode_point(self, message: bytes) -> None:
        point = decode_point(message)
        self._submit(lambda: self._take_point(point))

    def _take(self, decoded: DetectionsMessage) -> None:
        """Stop targets, and have others start on the next frame. Stops come first, as they make room."""
        wanted = []
        for detection in decoded.detections:
            if detection.box.w == 0 and detection.box.h == 0:
                self._places.stop(detection.id or detection.class_id)
            else:
                wanted.append(detection)
        starts, repeated = first_of_each(
            [
                TargetStart(name, detection.box, decoded.stamp_ns, detection.class_id)
                for name, detection in zip(names_of(wanted), wanted, strict=True)
            ]
        )
        if repeated:
            self._refuse_repeated(repeated)
        if starts and self._is_ahead(decoded.stamp_ns):
            self._refuse_ahead(starts)
        else:
            self._take_starts(starts)

    def _take_starts(self, starts: Sequence[TargetStart]) -> None:
        """Take as many as there is room for; a message may name thousands."""
        held = self._places.held()
        leaving = self._places.leaving({start.name for start in starts})
        wrong: list[EtdError] = []
        refused: list[str] = []
        for start in starts:
            try:
                check_target(start.name or "target", start.box, start.stamp_ns)
            except EtdError as err:
                wrong.append(err)
                continue
            if start.name not in held and not self._has_room(held, leaving):
                refused.append(start.name)
                continue
            name = start.name or self._places.next_name("target", held)
            held.add(name)
            class_id = start.class_id or self._places.class_of(name)
            self._places.new[name] = TargetStart(name, start.box, start.stamp_ns, class_id)
        if wrong:
            more = f" ({len(wrong)} boxes of one message are wrong)" if len(wrong) > 1 else ""
            self._refusals.note("box", f"{wrong[0]}{more}", len(wrong))
        if refused:
            self._refuse_for_room(refused)

    def _take_point(self, point: PointMessage) -> None:
        # Whoever clicks means what is there now, whichever clock his viewer stamps by.
        held = self._places.held()
        name = self._places.next_name("point", held)
        if self._has_room(held, self._places.leaving(set())):
            self._places.clicks.append(Click(name, point.x, point.y))
        else:
            self._refuse_for_room([name])

    def _remember(self) -> None:
        try:
            self._memory.save()
        except EtdError as err:
            self._node.count_error(err)

    # --- who may be followed

    def _has_room(self, held: set[str], leaving: Iterator[str]) -> bool:
        """Whether there is room for one more, which those that leave may make; `held` has them no more."""
        while len(held) >= self._node.options.targets_max:
            name = next(leaving, None)
            if name is None:
                return False
            self._places.stop(name)
            held.discard(name)
            self._node.get_logger().info(
                f"target {name!r}, which is lost or off the sensor, makes room for a new one",
                throttle_duration_sec=REMARKS_PERIOD_S,
            )
        return True

    def _refuse_for_room(self, names: Sequence[str]) -> None:
        self._refusals.note(
            "room",
            f"{len(names)} new targets ({named(names)}) are refused, as targets_max = {self._node.options.targets_max} "
            "are followed: give each object an id that stays the same from message to message, stop what is gone by "
            "a box of size 0, or set targets_max higher",
            len(names),
        )

    def _refuse_repeated(self, names: Sequence[str]) -> None:
        self._refusals.note(
            "twice",
            f"{len(names)} boxes ({named(names)}) are refused, as an earlier one in their message has the same id, and "
            "counts: give each object an id of its own",
            len(names),
        )

    def _is_ahead(self, stamp_ns: int) -> bool:
        return self._clock.ahead_s(stamp_ns) > START_AHEAD_MAX_S

    def _hold_against(self, stamp_ns: int) -> None:
        """Refuse what is to start far after a frame (ns): as it came, the events' time may not have been known."""
        self._clock.note(stamp_ns)
        ahead = [target.name for target in self._places.new.values() if self._is_ahead(target.stamp_ns)]
        self._refuse_ahead([self._places.new.pop(name) for name in ahead])

    def _say_late(self, stamp_ns: int) -> None:
        """Warn of boxes that are old when they start with a frame (ns)."""
        stamped = [target for target in self._places.new.values() if target.stamp_ns > 0]
        late_s = {target.name: (stamp_ns - target.stamp_ns) * 1e-9 for target in stamped}
        late = [name for name, old_s in late_s.items() if old_s > START_LATE_MAX_S]
        if late:
            self._node.warn(
                f"{len(late)} targets ({named(late)}) start at boxes that are {late_s[late[0]]:.2f} s old: what moves "
                "is elsewhere by now: send boxes within 0.1 s of what they were seen in"
            )

    def _refuse_ahead(self, starts: Sequence[TargetStart]) -> None:
        if not starts:
            return
        self._refusals.note(
            "clock",
            f"{len(starts)} targets ({named([start.name for start in starts])}) are refused, as they start "
            f"{self._clock.ahead_s(starts[0].stamp_ns):.0f} s after the newest events: the sender's clock is "
            "ahead of the events', or another: stamp a box as the events are stamped in which it was seen, or 0: now",
            len(starts),
        )


def _started(tracker: MultiTracker, target: TargetStart) -> EtdError | None:
    """Start a target, or start it again; why it cannot be."""
    try:
        tracker.start_again(target.name, target.box, target.stamp_ns, target.class_id)
    except EtdError as err:
        return err
    return None


def _path(text: str) -> Path | None:
    return Path(text) if text else None


def _from_options(options: TrackingOptions) -> list[TargetStart]:
    from_file = targets_from_file(Path(options.targets_file)) if options.targets_file else []
    targets = unique_targets([*from_file, *targets_from_text(options.targets)])
    if len(targets) > options.targets_max:
        msg = (
            f"targets and targets_file name {len(targets)} targets, more than targets_max = {options.targets_max}: "
            "name fewer, or set targets_max higher"
        )
        raise TargetError(msg)
    return targets
