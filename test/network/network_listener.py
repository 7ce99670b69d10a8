"""Run on a host: prints a line of JSON for each message of boxes and each node's diagnostics that arrive there.

Argument: the topic of the boxes.
"""

from __future__ import annotations

import json
import sys

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from vision_msgs.msg import Detection2DArray

from etd_ros.nodes.connections import FRAME_QOS
from msg_adapters import decode_detections, decode_diagnostics


def say(**values: object) -> None:
    print(json.dumps(values), flush=True)  # noqa: T201


def take_boxes(message: bytes) -> None:
    decoded = decode_detections(message)
    say(boxes=len(decoded.detections), stamp_ns=decoded.stamp_ns)


def take_diagnostics(message: bytes) -> None:
    for status in decode_diagnostics(message).statuses:
        say(node=status.name, values=dict(status.values))


def main(topic: str) -> None:
    rclpy.init()
    node = Node("listener")
    node.create_subscription(Detection2DArray, topic, take_boxes, FRAME_QOS, raw=True)
    node.create_subscription(DiagnosticArray, "/diagnostics", take_diagnostics, FRAME_QOS, raw=True)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return


if __name__ == "__main__":
    main(sys.argv[1])
