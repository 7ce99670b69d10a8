"""Finds what moves, in all of the sensor, from frames alone: whatever the method that tracks it then."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.parameters import Parameters, parameter
from etd_ros.tracking.camera_motion import CameraMotion
from etd_ros.tracking.clusters import Clusters, Sighting
from etd_ros.tracking.recent_events import NEVER_NS, RecentEvents

WINDOW_S = 0.06
LOOK_NS, CAMERA_LOOK_NS = 30_000_000, 40_000_000
"""Distance of looks (ns) with a still and with a moving camera."""
SLOW_WINDOW_S, SLOW_LOOKS = 0.2, 3
"""Every so many looks go further back, for things too slow to be seen in the short window ..."""
SLOW_MOTION_PX = 20.0
"""... in which they move by less than this."""
OVERLAP_MAX = 0.3
SECTORS = (8, 6)
"""Columns and rows that the sensor is divided into to tell how much of it moves."""
SECTOR_BUSY, SECTORS_BUSY = 0.15, 0.12
"""A sector is busy if so many of its cells are; with so many busy sectors the camera may be moving."""
CAMERA_WINDOW_S = 0.04
"""The events in which a camera's motion is looked for first."""
CAMERA_LOOKS = 2
"""Before a still camera, every so many looks at a busy sensor ask whether it moves, and those that go further back."""
MEMORY, FIRST_MEMORY, CAMERA_STARTS, CAMERA_STOPS = 0.6, 0.6, 0.45, 0.2
"""The camera moves from when, in this fading memory of looks, so many said so, until few of them do; a
first look that has to decide at once counts half as much again."""
FLOCK_MIN, FLOCK_SHARE, FLOCK_EXTENT = 4, 0.5, 0.3
"""So many things that move alike, this share of all, over so much of the sensor are its background."""
FLOCK_TOLERANCE, FLOCK_TOLERANCE_PX_S, FLOCK_ERRORS = 0.25, 15.0, 2.0


@dataclass(frozen=True, slots=True)
class DiscoveryConfig(Parameters):
    """Parameters of finding moving objects, by themselves or at a click."""

    max_targets: int = parameter(8, "Most targets that are started by themselves at once.", low=1, high=1000)
    size_min_px: float = parameter(
        8.0, "Shortest longer side of an object (pixels). Higher ignores more.", low=2.0, high=1000.0
    )
    size_max_share: float = parameter(
        0.8, "Longest side of an object, in parts of the sensor's same side.", low=0.05, high=1.0
    )
    seen_s: float = parameter(
        0.06,
        "How long an object is seen before it is started (s). Higher starts later, and less that is none.",
        low=0.0,
        high=10.0,
    )
    gone_s: float = parameter(
        1.0, "A target that started by itself is dropped when it was not tracked for longer (s).", low=0.0, high=3600.0
    )
    click_wait_s: float = parameter(2.0, "How long a click waits for the object there (s).", low=0.0, high=3600.0)


class Discovery:
    """Finds moving objects on the frames of one sensor.

    Before a still camera an object is a cluster of events that move alike; before a moving one, what does not move
    with the picture. Nothing is found while too much moves to tell.

    Args:
        width, height: sensor size (pixels).
        config: parameters.

    Attributes:
        events: the newest events.
        sightings: what the last look found.
        clusters: the clusters of events in it, of any size; none with a moving camera.
        flock: those of them that move with the picture: things, or parts of a background that hardly has events.
        stamp_ns: the time of that look (ns).
    """

    def __init__(self, width: int, height: int, config: DiscoveryConfig | None = None) -> None:
        self.config = config or DiscoveryConfig()
        self.sightings: list[Sighting] = []
        self.clusters: list[Sighting] = []
        self.flock: list[Sighting] = []
        self.stamp_ns = NEVER_NS
        self.events = RecentEvents(width, height)
        self._clusters = Clusters(self.events)
        self._camera = CameraMotion(self.events)
        self._camera_moves = self._busy = False
        self._camera_memory: float | None = None
        self._looks = 0

    @property
    def camera_moves(self) -> bool:
        """Whether the whole picture moves."""
        return self._camera_moves

    def take(self, stamp_ns: int, data: npt.NDArray[np.uint8]) -> None:
        """Take the next frame: its end (ns) and its levels, uint8, shape (height, width, 2).

        A stamp below the last one starts the stream again.
        """
        if stamp_ns < self.events.stamp_ns:
            self.stamp_ns, self.sightings, self.clusters, self.flock = NEVER_NS, [], [], []
            self._camera_moves, self._camera_memory = False, None
        self.events.take(stamp_ns, data)

    def is_due(self) -> bool:
        """Whether the last look is so long ago that another one would tell something new."""
        return self.events.stamp_ns - self.stamp_ns >= (CAMERA_LOOK_NS if self._camera_moves else LOOK_NS)

    def look(self, *, thorough: bool = False) -> list[Sighting]:
        """What moves now.

        Args:
            thorough: look for slow things, too, which is done now and then otherwise.
        """
        self.stamp_ns = self.events.stamp_ns
        self._looks += 1
        clusters: list[Sighting] = []
        self._busy = False
        if not self._camera_moves:
            is_slow_look = thorough or self._looks % SLOW_LOOKS == 0
            clusters = self._clusters.find(self.events.points(WINDOW_S))
            if is_slow_look:
                clusters += self._slow(clusters)
            # A camera that turns slowly keeps the sensor busy in the longer window only.
            self._busy = (is_slow_look or self._looks % CAMERA_LOOKS == 0) and self._is_busy()
        found = self._among_camera_motion(at_once=thorough) if self._camera_moves or self._busy else []
        flock: list[Sighting] = []
        if not self._camera_moves:
            found, flock = self._told_from_flock(clusters)
        self.clusters = [] if self._camera_moves else clusters
        self.sightings = [sighting for sighting in found if self._has_size(sighting.box)]
        self.flock = [sighting for sighting in flock if self._has_size(sighting.box)]
        return self.sightings

    def _among_camera_motion(self, *, at_once: bool) -> list[Sighting]:
        """What moves otherwise than the camera; whether that moves is decided by several looks, or `at_once`."""
        if not self._camera_moves:
            self._camera.window_s = CAMERA_WINDOW_S
        found = self._camera.look(self.events.points(self._camera.window_s), moves=self._camera_moves)
        if not self._camera_moves and self._camera.motion is not None:
            # Only now is it known how far back the events have to go.
            found = self._camera.look(self.events.points(self._camera.window_s), moves=self._camera_moves)
        says_so = float(self._camera.motion is not None)
        if self._camera_memory is None and at_once:
            self._camera_memory = FIRST_MEMORY * says_so
        else:
            self._camera_memory = MEMORY * (self._camera_memory or 0.0) + (1 - MEMORY) * says_so
        self._camera_moves = self._camera_memory > (CAMERA_STOPS if self._camera_moves else CAMERA_STARTS)
        return found

    @property
    def picture_moves(self) -> bool:
        """Whether so much moved in the last look that it may have been the camera that did."""
        return self._camera_moves or self._busy or bool(self.flock)

    def _is_busy(self) -> bool:
        """Whether so much of the sensor has events that the camera may be moving."""
        cells = (self.events.counts >= 2).astype(np.float32)
        sectors = cv2.resize(cells, SECTORS, interpolation=cv2.INTER_AREA)
        return float((sectors > SECTOR_BUSY).mean()) > SECTORS_BUSY

    def _slow(self, known: list[Sighting]) -> list[Sighting]:
        """Things that have too few events in the short window."""
        found = self._clusters.find(self.events.points(SLOW_WINDOW_S))
        return [
            sighting
            for sighting in found
            if np.hypot(*sighting.velocity) * SLOW_WINDOW_S < SLOW_MOTION_PX
            and not any(shared(sighting.box, other.box) > OVERLAP_MAX for other in known)
        ]

    def _told_from_flock(self, sightings: list[Sighting]) -> tuple[list[Sighting], list[Sighting]]:
        """The others, and the parts of a background that hardly has events: they move alike, all over the sensor."""
        if len(sightings) < FLOCK_MIN:
            return sightings, []
        velocities = np.array([sighting.velocity for sighting in sightings])
        errors = FLOCK_ERRORS * np.array([sighting.velocity_error for sighting in sightings])
        differences = np.hypot(*(velocities[:, None] - velocities).transpose(2, 0, 1))
        tolerances = FLOCK_TOLERANCE_PX_S + FLOCK_TOLERANCE * np.hypot(*velocities.T)[:, None]
        alike = differences < tolerances + np.hypot(errors[:, None], errors)
        common = np.median(velocities[alike[int(alike.sum(axis=1).argmax())]], axis=0)
        tolerance = FLOCK_TOLERANCE_PX_S + FLOCK_TOLERANCE * np.hypot(*common)
        flock = np.hypot(*(velocities - common).T) < tolerance + errors
        if flock.sum() < max(FLOCK_MIN, FLOCK_SHARE * len(sightings)):
            return sightings, []
        corners = np.array([(s.box.x, s.box.y, s.box.x + s.box.w, s.box.y + s.box.h) for s in sightings])[flock]
        width, height = corners[:, 2:].max(axis=0) - corners[:, :2].min(axis=0)
        if width * height < FLOCK_EXTENT * self.events.width * self.events.height:
            return sightings, []
        others = [sighting for sighting, is_in in zip(sightings, flock, strict=True) if not is_in]
        return others, [sighting for sighting, is_in in zip(sightings, flock, strict=True) if is_in]

    def _has_size(self, box: Box) -> bool:
        share = self.config.size_max_share
        fits = box.w <= share * self.events.width and box.h <= share * self.events.height
        return fits and max(box.w, box.h) >= self.config.size_min_px


def shared(box: Box, other: Box) -> float:
    """The area that two boxes share, in parts of the smaller one's: 1 where one lies in the other."""
    w = min(box.x + box.w, other.x + other.w) - max(box.x, other.x)
    h = min(box.y + box.h, other.y + other.h) - max(box.y, other.y)
    return max(0.0, w) * max(0.0, h) / min(box.w * box.h, other.w * other.h)
