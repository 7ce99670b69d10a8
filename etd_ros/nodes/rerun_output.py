"""What a node tracks, in the Rerun viewer: the parameter `rerun`."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from queue import Full, Queue

import numpy as np
import numpy.typing as npt

from etd_ros.nodes.base import EtdNode
from etd_ros.rerun_log import RerunError, RerunLog, is_file, rerun_log
from etd_ros.tracking import TargetReport

FRAMES_WAITING_MAX = 100
VIEWER_CLOSE_S = 1.0
"""How long a node that ends waits for a viewer (s): one that has gone away may never answer."""

_Frame = tuple[int, npt.NDArray[np.uint8], tuple[TargetReport, ...], npt.NDArray[np.uint8] | None, float | None]


class RerunOutput:
    """A log that a node may have. If it fails, the node says so and goes on without it.

    Logging has a thread of its own and drops frames when it does not keep up: the SDK waits for a viewer that does not
    answer any more, for as long as it takes, and boxes must not.

    Args:
        node: which node.
        destination: what `rerun_log` takes; empty for no log.

    Raises:
        RerunError: there can be no such log.
        OutputError: the file cannot be written.
    """

    def __init__(self, node: EtdNode, destination: str) -> None:
        self._node = node
        self._queue: Queue[_Frame | None] = Queue(FRAMES_WAITING_MAX)
        self._dropped = 0
        self._thread: threading.Thread | None = None
        if destination:
            stack = ExitStack()
            log = stack.enter_context(rerun_log(destination))
            self._close_s = None if is_file(destination) else VIEWER_CLOSE_S
            self._thread = threading.Thread(target=self._run, args=(stack, log), name="rerun", daemon=True)
            self._thread.start()

    @property
    def is_open(self) -> bool:
        """Whether what is added goes anywhere."""
        return self._thread is not None and self._thread.is_alive()

    def add(
        self,
        stamp_ns: int,
        frame_data: npt.NDArray[np.uint8],
        reports: tuple[TargetReport, ...],
        image: npt.NDArray[np.uint8] | None,
        nzge: float | None,
    ) -> None:
        """Log a frame, as `RerunLog.add`, soon."""
        if not self.is_open:
            return
        try:
            self._queue.put_nowait((stamp_ns, frame_data, reports, image, nzge))
        except Full:
            self._dropped += 1
            self._node.warn(f"the Rerun viewer does not keep up: {self._dropped} frames were not logged so far")

    def close(self) -> None:
        """Finish the log; a file gets its name. A viewer that does not answer is not waited for: the SDK would wait for
        ever."""
        if self._thread is None:
            return
        start_s = time.monotonic()
        try:
            self._queue.put(None, timeout=self._close_s)
        except Full:
            return
        waited_s = time.monotonic() - start_s
        self._thread.join(None if self._close_s is None else max(self._close_s - waited_s, 0.0))

    def _run(self, stack: ExitStack, log: RerunLog) -> None:
        try:
            with stack:
                while (frame := self._queue.get()) is not None:
                    log.add(*frame)
        except RerunError as err:
            self._node.count_error(err)
