"""Stages that follow the stream from sensor to sensor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from etd_ros.stream import StreamBatch


class _Stage(Protocol):
    def reset(self) -> None: ...


StageT = TypeVar("StageT", bound=_Stage)


class PerSensor(Generic[StageT]):
    """A stage that is made anew when the sensor size changes, and reset where a stream starts.

    Args:
        make: makes the stage for a width and a height (pixels).
    """

    def __init__(self, make: Callable[[int, int], StageT]) -> None:
        self._make = make
        self._size: tuple[int, int] | None = None
        self._stage: StageT

    def at(self, batch: StreamBatch | None) -> StageT:
        """The stage for the next batch; None for the same as the last time, which is there by then."""
        if batch is None:
            return self._stage
        size = (batch.events.width, batch.events.height)
        if size != self._size:
            self._stage = self._make(*size)
            self._size = size
        elif batch.restart is not None:
            self._stage.reset()
        return self._stage

    def forget(self) -> None:
        """Have the next batch's stage made anew, as where settings have changed."""
        self._size = None
