"""The discovery server starts as docs/machines.md has it, also where ROS came as Python packages."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from network_hosts import TIMEOUT_S


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def end(group: int) -> None:
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGTERM)


# What Python sets where ROS came as packages of its own, and by which it knows that it has.
SET_BY_PYTHON = ("LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")


@pytest.fixture
def environment() -> dict[str, str]:
    """Of a shell in which the virtual environment is activated; a sourced ROS is left as it is."""
    left_out = SET_BY_PYTHON if SET_BY_PYTHON[1] in os.environ else ()
    kept = {name: value for name, value in os.environ.items() if name not in left_out}
    return {**kept, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{kept['PATH']}"}


@pytest.mark.parametrize("is_direct", [False, True])
def test_the_server_starts(repository, environment, is_direct):
    text = (repository / "docs" / "machines.md").read_text()
    (command,) = re.findall(r"^    (fastdds discovery .*?) +#", text, re.MULTILINE)
    (export,) = re.findall(r"^    (export LD_LIBRARY_PATH=.*)$", text, re.MULTILINE)
    command = command.replace("10.0.0.1", "127.0.0.1").replace("11811", str(free_port()))
    if is_direct:
        command = f"{export}; {command.replace('fastdds discovery', 'fast-discovery-server')}"
    with subprocess.Popen(
        ["sh", "-c", command],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as shell:
        assert shell.stdout is not None
        deadline = threading.Timer(TIMEOUT_S, end, (shell.pid,))
        deadline.start()
        said = []
        try:
            for line in shell.stdout:
                said.append(line)
                if "Server is running" in line:
                    break
        finally:
            deadline.cancel()
            end(shell.pid)
    assert "Server is running" in "".join(said)
