"""Boxes and states out, and `~/reset`: what `tracker` and `pipeline` share, beside the targets that come in."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from diagnostic_msgs.msg import DiagnosticArray
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
from etd_ros.nodes.worker import Task
from etd_ros.overlay import draw_overlay
from etd_ros.parameters import ParameterError, parameter
from etd_ros.targets import targets_from_text
from etd_ros.tracking import DEFAULT_METHOD, METHODS, TargetReport, TargetState, check_target
from msg_adapters import (
    Detection,
    DiagnosticStatus,
    Level,
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

    AT_ONCE: ClassVar[frozenset[str]] = NodeOptions.AT_ONCE | {"targets_max"}

    method: str = parameter(DEFAULT_METHOD, "tracking method", choices=tuple(METHODS))
    targets_file: str = parameter("", "BOXES.csv: targets start at the first row of each name")
    targets: str = parameter(
        "", "targets as NAME:X,Y,W,H or NAME:X,Y,W,H@STAMP_NS, which =CLASS may follow, separated by ';'"
    )
    targets_max: int = parameter(
        64,
        "most targets that are followed at once, whatever started them; a new one has the place of one lost for long",
        low=1,
        high=1000,
    )
    auto: bool = parameter(False, "moving objects become targets auto_1, auto_2, ... by themselves")
    memory_file: str = parameter(
        "", "file for the targets' last boxes, written five times a second: a node that starts again takes them back"
    )
    rerun: str = parameter(
        "", "logs to the Rerun viewer: FILE.rrd, `spawn` to start one, or the address of one that runs"
    )

    def __post_init__(self) -> None:
        NodeOptions.__post_init__(self)  # not super(): slots make another class of this one
        try:
            for target in targets_from_text(self.targets):
                check_target(target.name, target.box, target.stamp_ns)
        except EtdError as err:
            msg = f"parameter targets: {err}"
            raise ParameterError(msg) from err


OVERLAYS_PER_S = 30
"""Frames come by the hundred a second; more pictures than that would cost a network more than events do."""


class ResetService:
    """`~/reset`: has `forget` called, after which every target that was given a box starts again."""

    def __init__(self, node: EtdNode, forget: Task) -> None:
        self._node = node
        self._forget = forget
        node.create_service(Trigger, "~/reset", self._on_request)

    def _on_request(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._node.request(self._forget)
        response.success = True
        response.message = (
            "every target with a box starts again at it; those that a click or motion started are forgotten"
        )
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
        search_regions: Callable[[], Sequence[Box] | None],
        class_of: Callable[[str], str],
        nzge: float | None = None,
    ) -> None:
        """Say what one frame brought; stamps, frame_id and NZGE are those of the frame.

        `search_regions` says where targets are looked for next, if somebody reads that. `class_of` says of a name what
        the target is, "" if nobody said: then its class is its name, which viewers show.
        """
        self._frames_tracked += 1
        self._states = {report.name: report.state for report in reports}
        found = [(report, report.box) for report in reports if report.box is not None]
        self._boxes += len(found)
        if self._detections.get_subscription_count():
            detections = [
                Detection(id=report.name, box=box, score=report.score, class_id=class_of(report.name) or report.name)
                for report, box in found
            ]
            self._detections.publish(encode_detections(detections, stamp_ns=stamp_ns, frame_id=frame_id))
        if self._status.get_subscription_count():
            statuses = [self._status_of(report, frame_id) for report in reports]
            self._status.publish(encode_diagnostics(statuses, stamp_ns=stamp_ns, frame_id=frame_id))
        if self._search_regions.get_subscription_count():
            regions = [Detection(id="", box=box, score=1.0, class_id="") for box in search_regions() or ()]
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
