"""Bytes per second of every topic that somebody reads, as a Markdown table.

Measures a running system, on any of its hosts, for example with
`python scripts/topic_bandwidth.py --duration 10 --interface eth0`. Nodes publish most topics only while somebody reads
them, so topics that nobody else reads are left out.
"""

from __future__ import annotations

import argparse
import importlib
import os
import time
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.node import Node

from etd_ros.nodes.connections import EVENT_QOS

# What ROS keeps for itself; it is little.
LEFT_OUT = ("/rosout", "/parameter_events")
DISCOVERY_S = 3.0


@dataclass
class Traffic:
    """What has come on one topic."""

    type_name: str
    messages: int = 0
    size_bytes: int = 0

    def take(self, message: bytes) -> None:
        """Count one message."""
        self.messages += 1
        self.size_bytes += len(message)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=10.0, metavar="S", help="to measure for (default: 10)")
    parser.add_argument("--interface", metavar="NAME", help="network interface whose bytes are counted, too")
    options = parser.parse_args()
    rclpy.init()
    node = Node(f"topic_bandwidth_{os.getpid()}")
    try:
        topics = subscribe(node)
        spin(node, DISCOVERY_S)
        before = {name: (traffic.messages, traffic.size_bytes) for name, traffic in topics.items()}
        wire = interface_bytes(options.interface) if options.interface else (0, 0)
        duration_s = spin(node, options.duration)
        print("| topic | type | messages/s | bytes a message | kB/s |\n|-|-|-|-|-|")
        for name, traffic in sorted(topics.items()):
            messages, size_bytes = traffic.messages - before[name][0], traffic.size_bytes - before[name][1]
            per_message = f"{size_bytes / messages:,.0f}" if messages else ""
            rates = f"{messages / duration_s:,.0f} | {per_message} | {size_bytes / duration_s / 1e3:,.1f}"
            print(f"| {name} | {traffic.type_name} | {rates} |")
        if options.interface:
            received, sent = (
                (now - then) / duration_s / 1e3
                for now, then in zip(interface_bytes(options.interface), wire, strict=True)
            )
            print(f"\n{options.interface}: {received:,.1f} kB/s received, {sent:,.1f} kB/s sent")
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
    return 0


def subscribe(node: Node) -> dict[str, Traffic]:
    """Listen to every topic that has a publisher and a reader; the types' packages must be installed."""
    spin(node, DISCOVERY_S)
    topics = {}
    for name, type_names in node.get_topic_names_and_types():
        if name in LEFT_OUT or not node.count_publishers(name) or not node.count_subscribers(name):
            continue
        package, _, message_name = type_names[0].split("/")
        message_class = getattr(importlib.import_module(f"{package}.msg"), message_name)
        topics[name] = Traffic(type_names[0])
        # Best effort matches every publisher; what is lost on the way here is missing in the table.
        node.create_subscription(message_class, name, topics[name].take, EVENT_QOS, raw=True)
    return topics


def spin(node: Node, duration_s: float) -> float:
    """Take messages for a time; how long it was (s)."""
    start_s = time.monotonic()
    while (passed_s := time.monotonic() - start_s) < duration_s:
        rclpy.spin_once(node, timeout_sec=min(0.1, duration_s - passed_s))
    return passed_s


def interface_bytes(name: str) -> tuple[int, int]:
    """Bytes that a network interface has received and sent since it is there."""
    statistics = Path("/sys/class/net") / name / "statistics"
    return int((statistics / "rx_bytes").read_text()), int((statistics / "tx_bytes").read_text())


if __name__ == "__main__":
    raise SystemExit(main())
