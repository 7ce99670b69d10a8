"""A video of tracking that plays at the pace of what it shows, however unevenly frames come."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from etd_ros.afterglow import Afterglow, FrameData, LastImage
from etd_ros.evaluation import TimedBox
from etd_ros.evaluation.overlaps import true_box
from etd_ros.overlay import OverlayError, Picture, VideoWriter, draw_overlay
from etd_ros.overlay_history import History
from etd_ros.tracking import TargetReport

FPS = 30
WIDTH = 1400
"""About the width of the pictures (pixels)."""
NS_PER_S = 1_000_000_000
SLOW_MIN, SLOW_MAX = 0.1, 1000.0
GAP_MAX_NS = 5 * NS_PER_S
"""Longer gaps between frames are left out."""


@contextmanager
def tracking_video(
    path: Path,
    *,
    slow: float = 1.0,
    proposals: bool = False,
    truth: Mapping[str, Sequence[TimedBox]] | None = None,
) -> Iterator[TrackingVideo]:
    """A video at 30 pictures/s, each of the newest frame; the file appears when the block succeeds.

    Args:
        path: an .mp4 file.
        slow: how many seconds of video show one of the recording.
        proposals: whether to draw what the reports say of them.
        truth: labelled boxes to draw, by target, in order of time.

    Raises:
        OverlayError: a factor out of [0.1, 1000], or the video cannot be written.
    """
    if not SLOW_MIN <= slow <= SLOW_MAX:
        msg = f"a video {slow:g} times as slow: give {SLOW_MIN:g} to {SLOW_MAX:g}; 1 is real time, 10 a tenth of it"
        raise OverlayError(msg)
    with VideoWriter(path, FPS) as writer:
        video = TrackingVideo(writer, NS_PER_S / (FPS * slow), proposals=proposals, truth=truth or {})
        yield video
        video.finish()


@dataclass(frozen=True, slots=True)
class _Shown:
    """A frame, and what its picture needs."""

    stamp_ns: int
    width: int
    reports: tuple[TargetReport, ...]
    image: npt.NDArray[np.uint8] | None


class TrackingVideo:
    """Takes every frame, and draws those that are the newest when a picture is due, over the fading ones before them;
    made by `tracking_video`."""

    def __init__(
        self, writer: VideoWriter, interval_ns: float, *, proposals: bool, truth: Mapping[str, Sequence[TimedBox]]
    ) -> None:
        self._writer = writer
        self._interval_ns = interval_ns
        self._proposals = proposals
        self._truth = truth
        self._history = History()
        self._afterglow = Afterglow()
        self._image = LastImage()
        self._newest: _Shown | None = None
        self._picture: Picture | None = None
        self._start_ns = 0
        self._written = 0

    def add(
        self,
        stamp_ns: int,
        frame_data: FrameData,
        reports: tuple[TargetReport, ...],
        image: npt.NDArray[np.uint8] | None = None,
    ) -> None:
        """Take the next frame; the arguments are those of `draw_overlay`. The arrays are kept, not copied.

        Where a frame has no image, the last one goes on being shown.

        Raises:
            OverlayError: the picture cannot be drawn, or the video cannot be written.
        """
        if self._newest is None or not 0 <= stamp_ns - self._newest.stamp_ns <= GAP_MAX_NS:
            self.finish()
            self._start_ns, self._written = stamp_ns, 0
        while self._due_ns < stamp_ns:
            self._write()
        self._history.take(stamp_ns, reports)
        self._take(stamp_ns, frame_data)
        self._image.take(image)
        self._newest = _Shown(stamp_ns, frame_data.shape[1], reports, self._image.at(frame_data.shape[:2]))
        self._picture = None

    def _take(self, stamp_ns: int, pixels: npt.NDArray[np.uint8]) -> None:
        """Frames fade, pictures take the place of the last one."""
        if pixels.ndim != 3 or pixels.shape[2] != 2:
            self._afterglow = Afterglow()
        self._afterglow.take(stamp_ns, pixels)

    def finish(self) -> None:
        """Show the newest frame, if a picture is due by its time."""
        if self._newest is not None and self._due_ns <= self._newest.stamp_ns:
            self._write()

    @property
    def _due_ns(self) -> int:
        """When the next picture is due, on the recording's clock (ns)."""
        return self._start_ns + math.ceil(self._written * self._interval_ns)

    def _write(self) -> None:
        if self._picture is None:
            self._picture = self._draw()
        self._writer.write(self._picture)
        self._written += 1

    def _draw(self) -> Picture:
        assert self._newest is not None
        shown = self._newest
        boxes = ((name, true_box(labels, shown.stamp_ns)) for name, labels in self._truth.items())
        return draw_overlay(
            self._afterglow.frame(),
            shown.reports,
            image=shown.image,
            stamp_ns=shown.stamp_ns,
            scale=_scale(shown.width * (1 if shown.image is None else 2)),
            proposals=self._proposals,
            truth={name: box for name, box in boxes if box is not None},
            history=self._history,
        )


def _scale(width: int) -> float:
    """Whole, or one over a whole number: pixels stay square, and all of one size."""
    scale = WIDTH / width
    return float(round(scale)) if scale >= 1 else 1 / round(1 / scale)
