"""`pipeline`: accumulator, reconstruction and tracker in one process; events in, boxes out."""

from __future__ import annotations

import sys

from sensor_msgs.msg import Image

from etd_ros.engine import Engine, Step, make_tracker
from etd_ros.nodes.base import FRAME_QOS, EtdNode, run_node
from etd_ros.nodes.event_input import EventInput
from etd_ros.nodes.target_topics import ResetService, TargetInput, TrackingOptions, TrackingOutput
from etd_ros.settings import STAGES
from etd_ros.stream import StreamBatch
from msg_adapters import EventMessage, encode_image


class Pipeline(EtdNode):
    """Decodes events once and hands frames over without serialisation; publishes only what somebody reads."""

    def __init__(self) -> None:
        super().__init__("pipeline", tuple(STAGES), TrackingOptions)
        self._targets = TargetInput(self)
        self._output = TrackingOutput(self)
        self._frames = self.create_publisher(Image, "~/frames", FRAME_QOS)
        self._images = self.create_publisher(Image, "~/image_raw", FRAME_QOS)
        self._engine: Engine | None = None
        make_tracker(self.options.method, 1, 1, self.settings)
        self._reset = ResetService(self, self._forget)
        self._input = EventInput(self, self._on_events, self._wanted)

    def diagnostics(self) -> dict[str, object]:
        """Figures for /diagnostics."""
        return {
            **super().diagnostics(),
            **self._input.diagnostics(),
            "frames tracked": self._output.frames,
            "reading events": self._input.subscribed,
            "targets": len(self._targets),
            **{f"state of {name}": state for name, state in self._output.states.items()},
        }

    def _wanted(self) -> bool:
        return bool(
            self._output.subscribers or self._frames.get_subscription_count() or self._images.get_subscription_count()
        )

    def _forget(self, _: bytes) -> None:
        self._engine = None

    def _on_events(self, message: EventMessage, batch: StreamBatch) -> None:
        events = batch.events
        if self._engine is None or (events.width, events.height) != (self._engine.width, self._engine.height):
            self._engine = Engine(events.width, events.height, method=self.options.method, settings=self.settings)
            self._targets.start_all(self._engine.tracker, int(events.t[0]))
        elif batch.restart is not None:
            self._engine.reset()
        self._targets.start_new(self._engine.tracker)
        for step in self._engine.feed(events):
            self._publish(step, message.frame_id)

    def _publish(self, step: Step, frame_id: str) -> None:
        stamp_ns = step.frame.stamp_ns
        if self._frames.get_subscription_count():
            self._frames.publish(encode_image(step.frame.data, stamp_ns=stamp_ns, frame_id=frame_id))
        if step.image is not None and self._images.get_subscription_count():
            self._images.publish(encode_image(step.image, stamp_ns=stamp_ns, frame_id=frame_id))
        self._output.publish(stamp_ns, frame_id, step.frame.data, step.image, step.reports)


def main() -> int:
    """Entry point of `ros2 run etd_ros pipeline`."""
    return run_node(Pipeline)


if __name__ == "__main__":
    sys.exit(main())
