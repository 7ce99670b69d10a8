"""The `pipeline` process that the live benchmark measures."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from etd_ros.benchmarking.live_load import Place
from etd_ros.benchmarking.streams import BenchmarkError

NODE = "pipeline"
END_TIMEOUT_S = 10.0
MIB = 2**20


class PipelineProcess:
    """A `pipeline` process, and what it costs.

    Args:
        place: where it works.
        log: file for what it prints.
        parameters: of the node, each as `NAME:=VALUE`.
    """

    def __init__(self, place: Place, log: Path, parameters: Sequence[str] = ()) -> None:
        self.started_ns = time.monotonic_ns()
        self._log = log
        remaps = ("-r", f"__ns:=/{place.namespace}", "-r", f"~/events:={place.events}")
        assignments = (word for parameter in parameters for word in ("-p", parameter))
        with log.open("wb") as output:
            self._child = subprocess.Popen(
                [sys.executable, "-m", "etd_ros.nodes", NODE, "--ros-args", *remaps, *assignments],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, "ROS_DOMAIN_ID": str(place.domain)},
            )

    @property
    def resident_mib(self) -> float:
        """Resident memory (MiB)."""
        pages = int(self._proc("statm").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / MIB

    @property
    def cpu_s(self) -> float:
        """CPU time so far, over all threads (s)."""
        # The name in parentheses may hold spaces.
        fields = self._proc("stat").rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def check(self) -> None:
        """Complain if it has ended.

        Raises:
            BenchmarkError: with the end of what it printed.
        """
        if self._child.poll() is not None:
            lines = self._log.read_text(errors="replace").strip().splitlines()
            msg = f"the pipeline ended with exit code {self._child.returncode}: {lines[-1] if lines else 'no output'}"
            raise BenchmarkError(msg)

    def end(self) -> None:
        """Interrupt it, wait, and kill it if it does not leave."""
        self._child.send_signal(signal.SIGINT)
        try:
            self._child.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()

    def _proc(self, name: str) -> str:
        self.check()
        return Path(f"/proc/{self._child.pid}/{name}").read_text()
