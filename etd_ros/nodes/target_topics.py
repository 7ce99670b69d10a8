"""Targets in, boxes and states out: the topics that `tracker` and `pipeline` share."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger
from vision_msgs.msg import Detection2DArray

from etd_ros.afterglow import Afterglow, LastImage
from etd_ros.boxes import Box
from etd_ros.cadence import Cadence
from etd_ros.errors import EtdError
from etd_ros.nodes.base import EtdNode
from etd_ros.nodes.node_parameters import NodeOptions
from etd_ros.nodes.rerun_output import RerunOutput
from etd_ros.nodes.target_memory import TargetMemory
from etd_ros.nodes.worker import Task
from etd_ros.overlay import draw_overlay
from etd_ros.parameters import parameter
from etd_ros.targets import TargetError, TargetStart, parse_target, targets_from_file, unique_targets
from etd_ros.tracking import DEFAULT_METHOD, METHODS, Click, MultiTracker, TargetReport, TargetState
from msg_adapters import (
    Detection,
    DetectionsMessage,
    DiagnosticStatus,
    Level,
    decode_detections,
    decode_point,
    encode_detections,
    encode_diagnostics,
    encode_image,
)

LEVELS = {
    TargetState.TRACKING: Level.OK,
    TargetState.RECOVERING: Level.WARN,
    TargetState.LOST: Level.ERROR,
    TargetState.IDLE: Level.STALE,
}


@dataclass(frozen=True, slots=True)
class TrackingOptions(NodeOptions):
    """Parameters of the nodes that track."""

    method: str = parameter(DEFAULT_METHOD, "tracking method", choices=tuple(METHODS))
    targets_file: str = parameter("", "BOXES.csv: targets start at the first row of each name")
    targets: str = parameter("", "targets as NAME:X,Y,W,H or NAME:X,Y,W,H@STAMP_NS, separated by ';'")
    auto: bool = parameter(False, "moving objects become targets auto_1, auto_2, ... by themselves")
    memory_file: str = parameter(
        "", "file for the targets' last boxes, written five times a second: a node that starts again takes them back"
    )
    rerun: str = parameter(
        "", "logs to the Rerun viewer: FILE.rrd, `spawn` to start one, or the address of one that runs"
    )


OVERLAYS_PER_S = 30
"""Frames come by the hundred a second; more pictures than that would cost a network more than events do."""
MEMORY_PERIOD_S = 0.2
UNNAMED_MAX = 64
"""Most boxes and clicks without a name that are targets at once: a detector that names nothing sends ever new ones."""


class TargetInput:
    """The targets that were asked for: by parameters, by boxes on `~/targets`, and by clicks on `~/clicked_point`.

    A box of width and height 0 stops the target of its id.

    Args:
        node: whose parameters and topic they are.
        submit: runs a task in the tracker's thread, where the targets are started; by default that is the worker's.

    Raises:
        EtdError: the targets of the parameters, or the memory's file, cannot be read.
    """

    def __init__(self, node: EtdNode, submit: Callable[[Task], None] = lambda task: task()) -> None:
        self._node = node
        self._submit = submit
        self._memory = TargetMemory(Path(node.options.memory_file) if node.options.memory_file else None)
        self._targets = {target.name: target for target in _from_options(node.options)}
        self._new: dict[str, TargetStart] = {}
        self._stopped: set[str] = set()
        self._clicks: list[Click] = []
        self._numbers = {"target": 0, "point": 0}
        self._unnamed: set[str] = set()
        self._has_begun = False

    def __len__(self) -> int:
        return len(self._targets)

    def open(self) -> None:
        """Listen."""
        self._node.reader(Detection2DArray, "~/targets", self._receive)
        self._node.reader(PointStamped, "~/clicked_point", self._receive_point)
        self._node.every(MEMORY_PERIOD_S, self._remember)

    def missing(self) -> list[str]:
        """What is missing where there is nothing to track, in a sentence."""
        if self._targets or self._unnamed or self._node.options.auto:
            return []
        boxes, points = (self._node.resolve_topic_name(topic) for topic in ("~/targets", "~/clicked_point"))
        return [
            f"waiting for targets on {boxes} (vision_msgs/msg/Detection2DArray, reliable): publish boxes there or "
            f"points on {points}, or set the parameter targets, targets_file or auto"
        ]

    def start_all(self, tracker: MultiTracker, stamp_ns: int, first_ns: int) -> None:
        """Start every target on a new tracker: at its box, or where the node's last life has left it.

        Args:
            tracker: the new tracker.
            stamp_ns: of its first frame (ns).
            first_ns: earliest time (ns) that the first data may be of. Targets that start before it are counted as
                errors when the node begins; they are tracked from the next frame on.
        """
        self._new.clear()
        self._stopped.clear()
        taken_back = set() if self._has_begun else self._take_back(tracker, stamp_ns)
        for target in tuple(self._targets.values()):
            if target.name in taken_back:
                continue
            self._start(tracker, target)
            if not self._has_begun:
                self._check_start(target, first_ns)
        self._has_begun = True

    def note(self, stamp_ns: int, tracker: MultiTracker, reports: tuple[TargetReport, ...]) -> None:
        """What a frame brought: remembered, and said in the log where clicks start nothing."""
        self._memory.note(stamp_ns, reports)
        for notice in tracker.take_notices():
            self._node.get_logger().warning(notice)
        self._unnamed.intersection_update({*self._targets, *tracker.targets, *tracker.waiting_clicks})

    def _take_back(self, tracker: MultiTracker, stamp_ns: int) -> set[str]:
        """Start targets where the memory has them; returns the names of all that it has."""
        remembered = self._memory.recall(stamp_ns)
        for target in remembered:
            if target.was_lost:
                self._node.get_logger().warning(f"{target.name} was lost before the restart: give it a new box")
                continue
            start = TargetStart(target.name, target.box)
            self._targets.setdefault(target.name, start)
            self._start(tracker, start)
            self._node.get_logger().info(f"{target.name} is taken back after {target.age_s:.1f} s")
        return {target.name for target in remembered}

    def _remember(self) -> None:
        try:
            self._memory.save()
        except EtdError as err:
            self._node.count_error(err)

    def start_new(self, tracker: MultiTracker) -> None:
        """Stop, start, or start again the targets that came since the last call."""
        for name in self._stopped & {*tracker.targets, *tracker.waiting_clicks}:
            tracker.stop(name)
        for target in self._new.values():
            self._start(tracker, target)
        for click in self._clicks:
            self._click(tracker, click)
        self._stopped.clear()
        self._new.clear()
        self._clicks.clear()

    def _click(self, tracker: MultiTracker, click: Click) -> None:
        try:
            tracker.click(click)
        except EtdError as err:
            self._node.count_error(err)

    def _start(self, tracker: MultiTracker, target: TargetStart) -> None:
        try:
            if target.name in tracker.targets:
                tracker.stop(target.name)
            tracker.start(target.name, target.box, target.stamp_ns)
        except EtdError as err:
            self._targets.pop(target.name, None)
            self._node.count_error(err)

    def _check_start(self, target: TargetStart, first_ns: int) -> None:
        try:
            target.check_start(first_ns)
        except TargetError as err:
            self._node.count_error(err)

    def _receive(self, message: bytes) -> None:
        self._node.worker.submit_request(self._decode, message)

    def _decode(self, message: bytes) -> None:
        decoded = decode_detections(message)
        self._submit(lambda: self._take(decoded))

    def _take(self, decoded: DetectionsMessage) -> None:
        for detection in decoded.detections:
            name = detection.id or detection.class_id
            if detection.box.w == 0 and detection.box.h == 0:
                self._stop(name)
                continue
            try:
                name = name or self._next_name("target")
            except TargetError as err:
                self._node.count_error(err)
                break
            target = TargetStart(name, detection.box, decoded.stamp_ns)
            self._targets[name] = target
            self._new[name] = target

    def _stop(self, name: str) -> None:
        self._targets.pop(name, None)
        self._new.pop(name, None)
        self._stopped.add(name)

    def _receive_point(self, message: bytes) -> None:
        self._node.worker.submit_request(self._decode_point, message)

    def _decode_point(self, message: bytes) -> None:
        # Whoever clicks means what is there now, whichever clock his viewer stamps by.
        point = decode_point(message)
        self._submit(lambda: self._clicks.append(Click(self._next_name("point"), point.x, point.y)))

    def _next_name(self, kind: str) -> str:
        """A name for what came without one.

        Raises:
            TargetError: there are too many already.
        """
        if len(self._unnamed) >= UNNAMED_MAX:
            msg = (
                f"more than {UNNAMED_MAX} targets came without a name: give each detection an id that stays the same "
                "from message to message, and stop what is gone by a box of size 0"
            )
            raise TargetError(msg)
        self._numbers[kind] += 1
        name = f"{kind}_{self._numbers[kind]}"
        self._unnamed.add(name)
        return name


class ResetService:
    """`~/reset`: has `forget` called, after which every target starts again."""

    def __init__(self, node: EtdNode, forget: Task) -> None:
        self._node = node
        self._forget = forget
        node.create_service(Trigger, "~/reset", self._on_request)

    def _on_request(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._node.request(self._forget)
        response.success, response.message = True, "every target starts again at its box"
        return response


class TrackingOutput:
    """Publishes `~/detections`, `~/search_regions`, `~/status` and `~/overlay`, and logs to the Rerun viewer."""

    def __init__(self, node: EtdNode) -> None:
        self._detections = node.publisher(Detection2DArray, "~/detections")
        self._search_regions = node.publisher(Detection2DArray, "~/search_regions")
        self._status = node.publisher(DiagnosticArray, "~/status")
        self._overlay = node.publisher(Image, "~/overlay")
        self._overlay_rate = Cadence(1 / OVERLAYS_PER_S)
        self._afterglow = Afterglow()
        self._image = LastImage()
        self._rerun = RerunOutput(node, node.options.rerun)
        self._name = node.get_fully_qualified_name().lstrip("/")
        self._frames_tracked = 0
        self._boxes = 0
        self._states: dict[str, TargetState] = {}

    @property
    def subscribers(self) -> int:
        """How many read the boxes, search regions, states or overlay; the Rerun viewer is one of them."""
        publishers = (self._detections, self._search_regions, self._status, self._overlay)
        return sum(publisher.get_subscription_count() for publisher in publishers) + self._rerun.is_open

    def close(self) -> None:
        """End the log to the Rerun viewer."""
        self._rerun.close()

    def counts(self) -> dict[str, int]:
        """Counters whose rates are reported."""
        return {"boxes": self._boxes}

    def level(self) -> tuple[Level, str]:
        """As the target that fares worst, among those that have started."""
        started = {name: state for name, state in self._states.items() if state is not TargetState.IDLE}
        if not started:
            return Level.OK, "running, no target has started"
        worst = max(started.values(), key=lambda state: LEVELS[state])
        names = [name for name, state in started.items() if state is worst]
        return LEVELS[worst], f"{worst.value}: {', '.join(names)}"

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics."""
        return {
            "frames tracked": self._frames_tracked,
            "boxes": self._boxes,
            "search region subscribers": self._search_regions.get_subscription_count(),
            **{f"state of {name}": state.value for name, state in self._states.items()},
        }

    def publish(
        self,
        stamp_ns: int,
        frame_id: str,
        frame: npt.NDArray[np.uint8],
        image: npt.NDArray[np.uint8] | None,
        reports: tuple[TargetReport, ...],
        search_regions: Sequence[Box] | None,
        nzge: float | None = None,
    ) -> None:
        """Say what one frame brought; stamps, frame_id and NZGE are those of the frame."""
        self._frames_tracked += 1
        self._states = {report.name: report.state for report in reports}
        found = [(report, report.box) for report in reports if report.box is not None]
        self._boxes += len(found)
        if self._detections.get_subscription_count():
            detections = [
                Detection(id=report.name, box=box, score=report.score, class_id=report.name) for report, box in found
            ]
            self._detections.publish(encode_detections(detections, stamp_ns=stamp_ns, frame_id=frame_id))
        if self._status.get_subscription_count():
            statuses = [self._status_of(report, frame_id) for report in reports]
            self._status.publish(encode_diagnostics(statuses, stamp_ns=stamp_ns, frame_id=frame_id))
        if self._search_regions.get_subscription_count():
            regions = [Detection(id="", box=box, score=1.0, class_id="") for box in search_regions or ()]
            self._search_regions.publish(encode_detections(regions, stamp_ns=stamp_ns, frame_id=frame_id))
        self._rerun.add(stamp_ns, frame, reports, image, nzge)
        if self._overlay.get_subscription_count():
            self._afterglow.take(stamp_ns, frame)
            self._image.take(image)
            if self._overlay_rate.is_due(time.monotonic_ns()):
                shown = self._image.at(frame.shape[:2])
                picture = draw_overlay(self._afterglow.frame(), reports, image=shown, stamp_ns=stamp_ns)
                self._overlay.publish(encode_image(picture, stamp_ns=stamp_ns, frame_id=frame_id))

    def _status_of(self, report: TargetReport, frame_id: str) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=LEVELS[report.state],
            name=f"{self._name}: {report.name}",
            message=report.state.value,
            hardware_id=frame_id,
            values=(("target", report.name), ("state", report.state.value), ("score", repr(report.score))),
        )


def _from_options(options: TrackingOptions) -> list[TargetStart]:
    from_file = targets_from_file(Path(options.targets_file)) if options.targets_file else []
    return unique_targets([*from_file, *map(parse_target, filter(None, options.targets.split(";")))])
