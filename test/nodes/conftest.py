"""Real node processes over DDS on the loopback, each test in a ROS domain of its own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from ros_domains import clear, fresh_domains

from etd_ros.nodes.connections import EVENT_QOS, LISTENER_QOS
from msg_adapters import decode_diagnostics

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(Path(__file__).resolve().parents[2] / "config" / "fastdds_shm.xml")
DOMAINS = fresh_domains()
TIMEOUT_S, ANSWER_S = 60.0, 10.0
"""DDS loses a request that is sent before the service has seen its client: without an answer it is sent again."""
PATIENT = ("-p", "queue_s:=3600.0")


class Bench:
    """Starts node processes, listens to topics, and waits for conditions."""

    def __init__(self, folder: Path) -> None:
        self.domain = next(DOMAINS)
        self.messages: dict[str, list[bytes]] = {}
        self.diagnostics: dict[str, dict[str, str]] = {}
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self._folder = folder
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=self.domain)
        self.node = Node("bench", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._keep: list[object] = []
        self.listen("/diagnostics", DiagnosticArray, self._take_diagnostics)

    def start(self, name: str, *arguments: str, ros: tuple[str, ...] = ()) -> subprocess.Popen[str]:
        """Start `python -m etd_ros.nodes NAME`; a node is patient on a busy machine, unless `ros` says otherwise."""
        ros = ros if name == "replay" else (*PATIENT, *ros)
        environment = {**os.environ, "ROS_DOMAIN_ID": str(self.domain), "PYTHONUNBUFFERED": "1"}
        with (self._folder / f"{name}.log").open("w") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "etd_ros.nodes", name, *arguments, *(("--ros-args", *ros) if ros else ())],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                text=True,
            )
        self.processes[name] = process
        return process

    def log(self, name: str) -> str:
        """What a process has printed so far."""
        return (self._folder / f"{name}.log").read_text()

    def listen(
        self, topic: str, kind: type, take: Callable[[bytes], None] | None = None, *, events: bool = False
    ) -> None:
        """Keep every message of a topic, as bytes."""
        kept = self.messages.setdefault(topic, [])
        self._keep.append(
            self.node.create_subscription(
                kind, topic, take or kept.append, EVENT_QOS if events else LISTENER_QOS, raw=True
            )
        )

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Spin until the condition holds; fail with the logs when it never does."""
        deadline_s = time.monotonic() + TIMEOUT_S
        while not condition():
            if time.monotonic() > deadline_s:
                logs = "\n".join(f"--- {name}\n{self.log(name)}" for name in self.processes)
                pytest.fail(f"waited in vain until {what}\n{self.diagnostics}\n{logs}")
            self.spin_once()

    def spin_once(self) -> None:
        """Take what has come, or wait for it a moment."""
        self._executor.spin_once(timeout_sec=0.05)

    def call(self, kind: type, service: str, request: object) -> Any:
        """The response of a service."""
        client = self.node.create_client(kind, service)
        self.wait_until(client.service_is_ready, f"{service} is there")
        answers = [client.call_async(request)]
        again_s = time.monotonic() + ANSWER_S

        def is_answered() -> bool:
            nonlocal again_s
            if time.monotonic() > again_s:
                answers.append(client.call_async(request))
                again_s += ANSWER_S
            return any(answer.done() for answer in answers)

        self.wait_until(is_answered, f"{service} answers")
        self.node.destroy_client(client)
        return next(answer.result() for answer in answers if answer.done())

    def change_state(self, node: str, *transitions: str) -> bool:
        """Drive a node through its life cycle; whether every transition succeeded."""
        requests = [ChangeState.Request(transition=Transition(label=label)) for label in transitions]
        return all(self.call(ChangeState, f"/{node}/change_state", request).success for request in requests)

    def set_parameter(self, node: str, name: str, value: Any) -> tuple[bool, str]:
        """Whether a parameter was set, and else why not."""
        parameter = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        (result,) = self.call(SetParameters, f"/{node}/set_parameters", request).results
        return result.successful, result.reason

    def figure(self, node: str, key: str) -> str:
        """A value of a node's diagnostics, empty while there is none."""
        return self.diagnostics.get(node, {}).get(key, "")

    def next_figure(self, node: str, key: str) -> str:
        """A value of the next diagnostics that come from a node."""
        self.diagnostics.pop(node, None)
        self.wait_until(lambda: node in self.diagnostics, f"{node} reports")
        return self.figure(node, key)

    def end(self, name: str, by: signal.Signals = signal.SIGINT) -> int:
        """Signal a process and return its exit code."""
        process = self.processes[name]
        if process.poll() is None:
            process.send_signal(by)
        return process.wait(timeout=TIMEOUT_S)

    def close(self) -> None:
        """End every process and the listening."""
        for process in self.processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self.processes.values():
            try:
                process.wait(timeout=TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()
        clear(self.domain)

    def _take_diagnostics(self, message: bytes) -> None:
        for status in decode_diagnostics(message).statuses:
            self.diagnostics[status.name] = {
                "level": status.level.name,
                "message": status.message,
                **dict(status.values),
            }


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """A bench whose processes are gone afterwards."""
    made = Bench(tmp_path)
    try:
        yield made
    finally:
        made.close()
