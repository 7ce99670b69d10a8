"""The Event Camera Dataset's text format: lines `t x y p`, t in seconds; video frames listed in images.txt."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from etd_ros.events import SENSOR_PIXELS_MAX, Events, check_pixel_map
from etd_ros.recordings.files import IMAGE_LIST, image_lines, is_file
from etd_ros.recordings.interface import (
    FRAME_ID,
    RecordedImage,
    Recording,
    RecordingError,
    TopicInfo,
    file_packets,
)
from msg_adapters import EventMessage

DAVIS240_SIZE = (240, 180)
CHUNK_BYTES = 1 << 18
LINE_BYTES_MIN = len("0 0 0 0\n")
ENCODING = "text"
FRACTION_DIGITS = 9
SECONDS_MAX = 2**62 // 1_000_000_000 - 1
"""The year 2116: later stamps are no seconds, and above those that conversion takes in nanoseconds."""
PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
PNG_HEAD = struct.Struct(">8s8xII")
"""Magic number, start of the first chunk, width, height."""


class EcdRecording(Recording):
    """events.txt, or the folder that holds it.

    The sensor size is `size`, else that of a first line `width height`, else that of the first image, else 240x180
    (the dataset's camera); events off it are an error, since the text itself does not tell.

    Raises:
        RecordingError: the file is missing or empty, or its first line is no event.
    """

    kind = "ECD text"

    def __init__(self, path: Path, size: tuple[int, int] | None = None) -> None:
        self.path = path
        self._text = path / "events.txt" if path.is_dir() else path
        self._index = self._text.with_name(IMAGE_LIST)
        with self._text.open("rb") as file:
            first = file.readline(CHUNK_BYTES)
        if not first.strip():
            msg = f"{self._text}: empty: it needs lines `t x y p`"
            raise RecordingError(msg)
        header = _size_line(first)
        self._skip = len(first) if header else 0
        image = next(self.images(), None)
        self.width, self.height = size or header or (image.data.shape[1::-1] if image else DAVIS240_SIZE)
        check_pixel_map(self.width, self.height)
        images = (TopicInfo("images", IMAGE_LIST),) if image else ()
        self.topics = (TopicInfo("events", "events.txt", encoding=ENCODING), *images)

    def packets(self) -> Iterator[EventMessage]:
        line = 2 if self._skip else 1
        with self._text.open("rb") as file:
            file.seek(self._skip)
            rest = b""
            while chunk := file.read(CHUNK_BYTES):
                whole, newline, rest = (rest + chunk).rpartition(b"\n")
                if len(rest) > CHUNK_BYTES:
                    msg = f"{self._text}: line {line + whole.count(10)} is too long: it needs lines `t x y p`"
                    raise RecordingError(msg)
                yield from self._parse(whole + newline, line)
                line += whole.count(b"\n") + len(newline)
            yield from self._parse(rest + b"\n", line)

    def images(self) -> Iterator[RecordedImage]:
        for number, fields in image_lines(self._index):
            try:
                stamp, name = fields
                stamp_ns = _nanoseconds(stamp)
            except ValueError as err:
                msg = f"{self._index}: line {number} is not `t file`, t in seconds: mend or remove it"
                raise RecordingError(msg) from err
            yield RecordedImage(stamp_ns, FRAME_ID, self._read_image(name))

    def _read_image(self, name: str) -> npt.NDArray[np.generic]:
        file = self._index.parent / name
        try:
            image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) if _is_readable_image(file) else None
        except cv2.error:
            image = None
        if image is None:
            msg = f"{file}: missing, or no image, though {self._index.name} lists it: copy it again"
            raise RecordingError(msg)
        return np.asarray(image)

    def _parse(self, text: bytes, line: int) -> Iterator[EventMessage]:
        capacity = len(text) // LINE_BYTES_MIN + 1
        t, x, y = np.empty(capacity, np.int64), np.empty(capacity, np.uint16), np.empty(capacity, np.uint16)
        p = np.empty(capacity, np.uint8)
        count, bad = _parse_lines(np.frombuffer(text, np.uint8), t, x, y, p)
        if bad >= 0:
            content = next(islice(text.split(b"\n"), bad, None))[:60].decode("ascii", "replace")
            msg = f"{self._text}: line {line + bad} ({content!r}) is not `t x y p` with t in seconds: mend or remove it"
            raise RecordingError(msg)
        events = Events(t[:count], x[:count], y[:count], p[:count], self.width, self.height)
        if count and (int(events.x.max()) >= self.width or int(events.y.max()) >= self.height):
            msg = (
                f"{self._text}: an event at ({int(events.x.max())}, {int(events.y.max())}) lies off a "
                f"{self.width}x{self.height} sensor: give the sensor's size with --size WIDTHxHEIGHT"
            )
            raise RecordingError(msg)
        if count:
            yield from file_packets(events, ENCODING)


def _is_readable_image(file: Path) -> bool:
    """Whether it is a file, and no PNG that claims more pixels than any sensor has: room for them is made at once."""
    if not is_file(file):
        return False
    with file.open("rb") as image:
        head = image.read(PNG_HEAD.size)
    if len(head) < PNG_HEAD.size:
        return False
    magic, width, height = PNG_HEAD.unpack(head)
    return bool(magic != PNG_MAGIC or width * height <= SENSOR_PIXELS_MAX)


def _size_line(line: bytes) -> tuple[int, int] | None:
    """The sensor size, where a file starts with one (as conversions of the dataset do)."""
    fields = line.split()
    if len(fields) != 2 or not all(field.isdigit() and len(field) <= 5 for field in fields):
        return None
    return int(fields[0]), int(fields[1])


def _nanoseconds(seconds: str) -> int:
    """Decimal seconds to nanoseconds, exactly: a float would lose some on today's epoch."""
    whole, _, fraction = seconds.partition(".")
    nanoseconds = int(whole) * 10**9 + int(fraction[:9].ljust(9, "0"))
    if not 0 <= nanoseconds < 2**63:
        msg = f"{seconds} s is out of range"
        raise ValueError(msg)
    return nanoseconds


@njit(cache=True, nogil=True)
def _number(text, i, limit):  # type: ignore[no-untyped-def]
    """(digits at i as a number, or -1 where there are none or it exceeds the limit; index after them)."""
    value, start = 0, i
    while i < len(text) and 48 <= text[i] <= 57:
        value = value * 10 + (text[i] - 48)
        if value > limit:
            return -1, i
        i += 1
    return (value if i > start else -1), i


@njit(cache=True, nogil=True)
def _blanks(text, i):  # type: ignore[no-untyped-def]
    """Index of the first byte from i on that is no blank, tab or carriage return."""
    while i < len(text) and (text[i] == 32 or text[i] == 9 or text[i] == 13):
        i += 1
    return i


@njit(cache=True, nogil=True)
def _parse_lines(text, t, x, y, p):  # type: ignore[no-untyped-def]
    """Fill the arrays from lines that end in a newline; return (events, index of the first bad line or -1)."""
    count, line, i = 0, 0, 0
    while i < len(text):
        i = _blanks(text, i)
        if i < len(text) and text[i] == 10:
            line += 1
            i += 1
            continue
        if i == len(text):
            break
        seconds, i = _number(text, i, SECONDS_MAX)
        fraction = 0
        if seconds >= 0 and i < len(text) and text[i] == 46:
            i += 1
            digits = 0
            while i < len(text) and 48 <= text[i] <= 57:
                if digits < FRACTION_DIGITS:
                    fraction = fraction * 10 + (text[i] - 48)
                    digits += 1
                i += 1
            while digits < FRACTION_DIGITS:
                fraction *= 10
                digits += 1
        column, i = _number(text, _blanks(text, i), 65535)
        row, i = _number(text, _blanks(text, i), 65535)
        polarity, i = _number(text, _blanks(text, i), 1)
        i = _blanks(text, i)
        is_line = i < len(text) and text[i] == 10
        if seconds < 0 or column < 0 or row < 0 or polarity < 0 or not is_line or count >= len(t):
            return count, line
        t[count] = seconds * 1_000_000_000 + fraction
        x[count] = column
        y[count] = row
        p[count] = polarity
        count += 1
        line += 1
        i += 1
    return count, -1
