"""What a node tracks, in the Rerun viewer: the parameter `rerun`."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np
import numpy.typing as npt

from etd_ros.nodes.base import EtdNode
from etd_ros.rerun_log import RerunError, RerunLog, rerun_log
from etd_ros.tracking import TargetReport


class RerunOutput:
    """A log that a node may have. If it fails, the node says so and goes on without it.

    Args:
        node: which node.
        destination: what `rerun_log` takes; empty for no log.

    Raises:
        RerunError: there can be no such log.
        OutputError: the file cannot be written.
    """

    def __init__(self, node: EtdNode, destination: str) -> None:
        self._node = node
        self._stack = ExitStack()
        self._log: RerunLog | None = self._stack.enter_context(rerun_log(destination)) if destination else None

    @property
    def is_open(self) -> bool:
        """Whether what is added goes anywhere."""
        return self._log is not None

    def add(
        self,
        stamp_ns: int,
        frame_data: npt.NDArray[np.uint8],
        reports: tuple[TargetReport, ...],
        image: npt.NDArray[np.uint8] | None,
        nzge: float | None,
    ) -> None:
        """Log a frame, as `RerunLog.add`."""
        if self._log is None:
            return
        try:
            self._log.add(stamp_ns, frame_data, reports, image, nzge)
        except RerunError as err:
            self._log = None
            self._stack.__exit__(type(err), err, err.__traceback__)
            self._node.count_error(err)

    def close(self) -> None:
        """Finish the log; a file gets its name."""
        self._log = None
        self._stack.close()
