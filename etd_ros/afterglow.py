"""Frames as eyes want them: each over those of the milliseconds before it, beside the last image."""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

FrameData = npt.NDArray[np.uint8]

FADE_NS = 5_000_000
"""Time constant with which earlier frames fade."""
GONE_NS = 3 * FADE_NS
"""Earlier frames are gone after this time, at a twentieth of their brightness."""


class Afterglow:
    """The newest frame over those just before it, which fade: a fine frame alone has too few events to show a shape.

    Taking a frame costs nothing; what is not looked at is never put together.
    """

    def __init__(self) -> None:
        self._frames: deque[tuple[int, FrameData]] = deque()

    def take(self, stamp_ns: int, frame_data: FrameData) -> None:
        """Take the next frame, uint8, shape (h, w, 2), which ends at `stamp_ns` (ns); it is kept, not copied.

        Earlier ones are forgotten when time goes back or the size changes.
        """
        frames = self._frames
        if frames and (stamp_ns < frames[-1][0] or frame_data.shape != frames[-1][1].shape):
            frames.clear()
        frames.append((stamp_ns, frame_data))
        while stamp_ns - frames[0][0] > GONE_NS:
            frames.popleft()

    def frame(self) -> FrameData:
        """The newest frame over the earlier ones, uint8, shape (h, w, 2); not to be changed.

        Raises:
            IndexError: no frame has been taken.
        """
        newest_ns, newest = self._frames[-1]
        shown: Any = newest
        for stamp_ns, frame_data in list(self._frames)[:-1]:
            share = math.exp((stamp_ns - newest_ns) / FADE_NS)
            faded = np.round(np.arange(256) * share).astype(np.uint8)
            shown = cv2.max(shown, cv2.LUT(frame_data, faded))
        return np.asarray(shown, np.uint8)


class LastImage:
    """The newest intensity image there was: a method that looks at few has none made for most frames."""

    def __init__(self) -> None:
        self._image: FrameData | None = None

    def take(self, image: FrameData | None) -> None:
        """Take the next frame's image, uint8, shape (h, w); None where it has none. It is kept, not copied."""
        self._image = self._image if image is None else image

    def at(self, size: tuple[int, ...]) -> FrameData | None:
        """The image, if there is one of this height and width (pixels)."""
        return self._image if self._image is not None and self._image.shape == size else None
