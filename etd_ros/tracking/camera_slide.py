"""In which direction all moves that a sliding camera sees, however near it is.

What stands still moves by its nearness, but all of it in one direction. Two pictures of the edges, a while apart, show
it: their correlation has a peak for each nearness, and these lie on one line from its middle. Over a way of ten cells
that is right to a fraction of a degree, where the flow of edges is off by several, for good: an edge that lies askew
seems too fast. The direction is believed if the parts of the sensor agree about it, each for itself: before a camera
that comes nearer, rolls, or stands before things that move, they do not.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.tracking.camera_slide_kernels import light_cells, likeness_along
from etd_ros.tracking.contour_kernels import Float32Array, Float64Array

Direction = tuple[float, float]
"""x and y, of length 1."""


class Slide(NamedTuple):
    """What a sliding camera sees.

    Attributes:
        direction: in which all moves.
        since_ns: it has done so at least from then on (ns), but for `TURNS_RAD`.
    """

    direction: Direction
    since_ns: int


COLUMNS, ROWS = 128, 96
"""A picture has at most so many cells, each of as many pixels as that takes."""
CELL_SAMPLES = 3
"""Along the side of a large one about so many are looked at."""
PADDED = 128, 160
"""It is correlated as one of so many rows and columns: sizes that are fast to transform, with room for the way."""
EDGE_CELLS, LIGHT_CELLS = 0.8, 4.0
"""Edges are this wide; what is as wide as this is no edge."""
PICTURES = 4
"""So many pictures are taken while the camera goes the way over which two are compared."""
CAPTURE_SHARE, LIT_SHARE = 0.25, 0.15
"""A picture takes the events of this share of the time between two of them, or until so much of it is lit."""
FIRST_S, SHORTEST_S, LONGEST_S = 0.2, 0.02, 0.5
"""The time between two pictures that are compared, at first and at its limits."""
WAY_CELLS = 8.0, 24.0
"""It is changed until what is most alike has gone so far between them ..."""
TIME_FACTOR = 1.25
"""... by this from one comparison to the next."""
BLOCKS = 2
"""Parts of the sensor, as many across as down, each compared for itself, on a frame of its own."""
DIRECTIONS = 240
NEAREST_CELLS, FARTHEST_CELLS, STEP_CELLS = 4.0, 40.0, 1.0
"""Between these ways the correlation is looked at, in so many directions; nearer, all of them look alike."""
NOISE_DEVIATIONS = 2.0
"""What exceeds the mean of the correlation by fewer standard deviations is noise."""
PEAK_DIRECTIONS = 5
"""A peak is so many directions wide to either side."""
APART_RAD = math.radians(15)
"""What is farther apart is another direction."""
CLEAR, BLOCK_CLEAR = 2.0, 1.5
"""A direction has so many times the likeness of any other one, over all parts and in one of them."""
BLOCK_AGREES_RAD, BLOCKS_MIN, DISSENT_CLEAR = math.radians(5), 3, 3.0
"""So many parts have to agree about it to this, and none may be as clear as this about another one."""
AGREES_RAD, AGREEING_MIN = math.radians(1), 3
"""It is known if so many of the last PICTURES clear comparisons agree with their median to this: these span the time of
two that have nothing in common, in which a hand goes another way."""
TURNS_RAD = math.radians(2)
"""What has turned by more is another direction since."""
UNCLEAR_MAX = 4
"""After so many comparisons in a row that are not clear it is not known any more."""


class CameraSlide:
    """Follows the direction in which all moves that the camera sees.

    Args:
        width: columns of the sensor.
        height: rows of it.
    """

    def __init__(self, width: int, height: int) -> None:
        self._cell_px = max(1, math.ceil(width / COLUMNS), math.ceil(height / ROWS))
        self._stride = max(1, round(self._cell_px / CELL_SAMPLES))
        # A sensor may be lower than a cell.
        rows, columns = (max(1, side // self._cell_px) for side in (height, width))
        self._lit = np.zeros((rows, columns), np.float32)
        angles = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
        self._directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        self._likeness = np.zeros((BLOCKS * BLOCKS, DIRECTIONS))
        self._ways = np.zeros(BLOCKS * BLOCKS)
        self.forget()

    def forget(self) -> None:
        """The camera stands, or the stream starts again."""
        self._sure = _SureDirection()
        self._time_s = FIRST_S
        self._last_ns: int | None = None
        self._picture: Float32Array | None = None
        self._compared = 0
        self._before: list[_Edges] = []
        self._lit.fill(0)

    @property
    def slide(self) -> Slide | None:
        """In which direction all moves; None while that is not known."""
        angle = self._sure.angle
        return None if angle is None else Slide((math.cos(angle), math.sin(angle)), self._sure.since_ns)

    def take(self, stamp_ns: int, start_ns: int, data: npt.NDArray[np.uint8]) -> None:
        """Take a frame: its end and start (ns), and its levels, uint8, shape (height, width, 2). What is to be done is
        spread over several."""
        if self._picture is None:
            self._picture = self._taken(stamp_ns, start_ns, data)
        elif self._before and self._compared < len(self._ways):
            self._compare_block(self._picture, self._compared)
            self._compared += 1
        else:
            if self._before:
                self._conclude()
            assert self._last_ns is not None
            edges = _Edges(_whitened(_spectrum(self._picture)), self._last_ns)
            self._before = [*self._before[1 - PICTURES :], edges]
            self._picture, self._compared = None, 0

    def _taken(self, stamp_ns: int, start_ns: int, data: npt.NDArray[np.uint8]) -> Float32Array | None:
        """The edges of the last while, shape (rows, columns); None before it is time for the next picture."""
        if self._last_ns is None:
            self._last_ns = start_ns
        step_s, since_s = self._time_s / PICTURES, (stamp_ns - self._last_ns) * 1e-9
        if since_s < (1 - CAPTURE_SHARE) * step_s:
            return None
        lit = light_cells(data, self._cell_px, self._stride, self._lit)
        if since_s < step_s and lit < LIT_SHARE * self._lit.size:
            return None
        edges, light = (cv2.GaussianBlur(self._lit, (0, 0), cells) for cells in (EDGE_CELLS, LIGHT_CELLS))
        self._last_ns = stamp_ns
        self._lit.fill(0)
        return np.asarray(edges - light, np.float32)

    def _compare_block(self, picture: Float32Array, number: int) -> None:
        """Compare one part of a picture with all of the oldest one."""
        block = np.zeros_like(picture)
        part = tuple(
            slice(place * size // BLOCKS, (place + 1) * size // BLOCKS)
            for place, size in zip(divmod(number, BLOCKS), picture.shape, strict=True)
        )
        block[part] = picture[part]
        product = cv2.mulSpectrums(_spectrum(block), self._before[0].spectrum, 0, conjB=True)
        alike = np.asarray(cv2.idft(product, flags=cv2.DFT_REAL_OUTPUT | cv2.DFT_SCALE), np.float32)
        alike /= max(float(alike.std()), 1e-9)
        self._ways[number] = likeness_along(
            alike, self._directions, NEAREST_CELLS, FARTHEST_CELLS, STEP_CELLS, NOISE_DEVIATIONS, self._likeness[number]
        )

    def _conclude(self) -> None:
        """Learn what the parts say together, and how far apart the next pictures should be."""
        angle, clearness = peak_of(self._likeness.sum(axis=0))
        agreeing, dissenting = 0, False
        for likeness in self._likeness:
            block_angle, block_clearness = peak_of(likeness)
            off = abs(between(block_angle, angle))
            agreeing += off < BLOCK_AGREES_RAD and block_clearness > BLOCK_CLEAR
            dissenting |= off > APART_RAD and block_clearness > DISSENT_CLEAR
        is_clear = clearness > CLEAR and agreeing >= BLOCKS_MIN and not dissenting
        self._sure.learn(angle if is_clear else None, self._before[0].stamp_ns)
        if len(self._before) < PICTURES:
            return
        shortest, longest = WAY_CELLS
        way = float(np.median(self._ways))
        if way < shortest:
            self._time_s = min(self._time_s * TIME_FACTOR, LONGEST_S)
        elif way > longest:
            self._time_s = max(self._time_s / TIME_FACTOR, SHORTEST_S)


class _Edges(NamedTuple):
    """A picture of edges: its whitened spectrum, and when it was taken (ns)."""

    spectrum: Float32Array
    stamp_ns: int


class _SureDirection:
    """A direction about which comparisons agree.

    Attributes:
        angle: its angle (rad); None while it is not known.
        since_ns: from when on that is known (ns).
    """

    def __init__(self) -> None:
        self.angle: float | None = None
        self.since_ns = 0
        self._at_first = 0.0
        self._comparisons: deque[tuple[float, int]] = deque(maxlen=PICTURES)
        self._unclear = 0

    def learn(self, angle: float | None, from_ns: int) -> None:
        """Take what a comparison with a picture of before (ns) says (rad); None if that is not clear."""
        if angle is None:
            self._unclear += 1
            if self._unclear >= UNCLEAR_MAX:
                self._comparisons.clear()
                self.angle = None
            return
        self._unclear = 0
        self._comparisons.append((angle, from_ns))
        offs = np.array([between(each, angle) for each, _ in self._comparisons])
        agreeing = np.abs(offs - np.median(offs)) < AGREES_RAD
        if agreeing.sum() < AGREEING_MIN:
            self.angle = None
            return
        was_known = self.angle is not None
        self.angle = angle + float(offs[agreeing].mean())
        if not was_known or abs(between(self.angle, self._at_first)) > TURNS_RAD:
            self._at_first = self.angle
            self.since_ns = min(ns for (_, ns), agrees in zip(self._comparisons, agreeing, strict=True) if agrees)


def between(angle: float, other: float) -> float:
    """The angle from another direction to one (rad), -pi to pi."""
    return (angle - other + math.pi) % (2 * math.pi) - math.pi


def peak_of(likeness: Float64Array) -> tuple[float, float]:
    """The angle of the most likeness (rad), and how many times that of any other direction it is.

    Args:
        likeness: in each direction, all round, shape (DIRECTIONS,).
    """
    best = int(likeness.argmax())
    near = np.arange(-PEAK_DIRECTIONS, PEAK_DIRECTIONS + 1)
    weights = likeness[(best + near) % DIRECTIONS]
    angle = (best + float(near @ weights) / max(float(weights.sum()), 1e-9)) * 2 * np.pi / DIRECTIONS
    turns = (np.arange(DIRECTIONS) - best) % DIRECTIONS * 2 * np.pi / DIRECTIONS
    others = likeness[np.minimum(turns, 2 * np.pi - turns) > APART_RAD]
    return angle, float(likeness[best]) / max(float(others.max()), 1e-9)


def _spectrum(picture: Float32Array) -> Float32Array:
    """Of a picture with room round it, shape (*PADDED, 2)."""
    rows, columns = picture.shape
    padded = np.zeros(PADDED, np.float32)
    padded[:rows, :columns] = picture
    return np.asarray(cv2.dft(padded, flags=cv2.DFT_COMPLEX_OUTPUT), np.float32)


def _whitened(spectrum: Float32Array) -> Float32Array:
    """Of a spectrum the phases alone: large things count no more than small ones, which have sharper peaks."""
    real, imaginary = spectrum[..., 0], spectrum[..., 1]
    # OpenCV's own rounds by where its numbers lie in memory, and tracks would differ from run to run.
    size = np.sqrt(real * real + imaginary * imaginary)
    return np.asarray(spectrum / (size + 1e-6)[..., None], np.float32)
