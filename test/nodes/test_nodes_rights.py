"""What the running nodes publish, read and serve is what security/policy.xml allows them: no right too few or many."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from conftest import Bench
from rclpy.node import Node
from sensor_msgs.msg import Image
from vision_msgs.msg import Detection2DArray

EVENTS = "/event_camera/events"
NODES = ("accumulator", "reconstruction", "tracker", "pipeline")
READERS = {
    "/accumulator/frames": Image,
    "/reconstruction/image_raw": Image,
    "/pipeline/detections": Detection2DArray,
}
"""Outputs that somebody must read for a node to read the events."""

ALL_PARAMETERS = ("-p", "use_sim_time:=true", "-p", "atsltd.entropy_region:=targets")
"""What makes nodes read more than by default; /clock and the search regions."""

Rights = set[tuple[str, str]]
"""(right, resolved name)."""


def resolved(name: str, namespace: str, node: str) -> str:
    if name.startswith("/"):
        return name
    base = namespace.rstrip("/")
    return f"{base}/{node}{name[1:]}" if name.startswith("~") else f"{base}/{name}"


def allowed(policy: Path, node: str, namespace: str = "/") -> Rights:
    """The rights of a node's profile, were it written for this namespace."""
    (profile,) = (found for found in ElementTree.parse(policy).iter("profile") if found.get("node") == node)
    return {
        (right, resolved(element.text or "", namespace, node))
        for rule in profile
        for right in rule.attrib
        for element in rule
    }


def used(observer: Node, node: str, namespace: str = "/") -> Rights:
    """What the ROS graph says of a node."""
    queries = {
        "publish": observer.get_publisher_names_and_types_by_node,
        "subscribe": observer.get_subscriber_names_and_types_by_node,
        "reply": observer.get_service_names_and_types_by_node,
        "request": observer.get_client_names_and_types_by_node,
    }
    return {(right, name) for right, query in queries.items() for name, _ in query(node, namespace)}


def visible(bench: Bench, node: str, namespace: str = "/") -> bool:
    return (node, namespace) in bench.node.get_node_names_and_namespaces()


@pytest.fixture
def nodes(bench: Bench, repository: Path) -> Bench:
    """All nodes as the launch files start them, reading all that they can."""
    for topic, kind in READERS.items():
        bench.listen(topic, kind)
    bench.start("replay", str(repository / "bags" / "demo"), "--clock", "--wait-for", "99")
    for name in NODES:
        bench.start(name, ros=("-r", f"~/events:={EVENTS}", *ALL_PARAMETERS))
    return bench


def test_the_policy_is_what_the_nodes_do(nodes: Bench, repository: Path):
    policy = repository / "security" / "policy.xml"
    readers = ("accumulator", "reconstruction", "pipeline")
    nodes.wait_until(lambda: all(nodes.figure(name, "reading events") == "True" for name in readers), "events are read")
    for name in (*NODES, "replay"):
        expected = allowed(policy, name)
        nodes.wait_until(
            lambda name=name, expected=expected: visible(nodes, name) and used(nodes.node, name) >= expected,
            f"{name} uses its rights {sorted(expected)}",
        )
        assert used(nodes.node, name) == expected


def test_in_another_namespace_the_rights_are_those_of_a_profile_of_that_namespace(bench: Bench, repository: Path):
    policy = repository / "security" / "policy.xml"
    bench.start("tracker", ros=("-r", "__ns:=/left", *ALL_PARAMETERS))
    expected = allowed(policy, "tracker", "/left")
    bench.wait_until(
        lambda: visible(bench, "tracker", "/left") and used(bench.node, "tracker", "/left") >= expected,
        f"the tracker uses its rights {sorted(expected)}",
    )
    assert used(bench.node, "tracker", "/left") == expected
    assert ("subscribe", "/left/accumulator/frames") in expected


@pytest.mark.parametrize("name", ["tracker", "replay"])
@pytest.mark.parametrize("has_enclave", [False, True])
def test_a_node_that_is_to_be_secure_and_cannot_be_does_not_start(
    bench, tmp_path, monkeypatch, repository, name, has_enclave
):
    """The middleware that pip installs has no security: with keys or without, nothing runs in the open."""
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", str(tmp_path))
    if has_enclave:
        (tmp_path / "enclaves" / "etd_ros" / name).mkdir(parents=True)
    arguments = (str(repository / "bags" / "demo"),) if name == "replay" else ()
    process = bench.start(name, *arguments, ros=("--enclave", f"/etd_ros/{name}"))
    assert process.wait(timeout=60) == 2
    (line,) = (line for line in bench.log(name).splitlines() if line.startswith("etd_ros:"))
    assert "ROS_SECURITY_ENABLE=true" in line
    assert "docs/security.md" in line
    assert "Traceback" not in bench.log(name)
