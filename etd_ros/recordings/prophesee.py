"""Prophesee .raw files: header lines that start with `%`, then evt2, evt2.1 or evt3 words."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from etd_ros.events import check_pixel_map
from etd_ros.recordings.interface import Recording, RecordingError, TopicInfo, file_packets
from msg_adapters import EventMessage, Evt2Decoder, Evt3Decoder, Evt21Decoder, WordDecoder

CHUNK_BYTES = 1 << 16
HEADER_LINE_MAX = 4096
HEADER_LINES_MAX = 1000
WORD_BYTES = {"evt2": 4, "evt21": 8, "evt3": 2}
ENCODING_BY_NAME = {
    "2.0": "evt2",
    "2.1": "evt21",
    "3.0": "evt3",
    "EVT2": "evt2",
    "EVT21": "evt21",
    "EVT3": "evt3",
}
GEOMETRY = re.compile(r"(\d+)x(\d+)")


class PropheseeRecording(Recording):
    """A .raw file. Times are the sensor's own, from near 0 at the camera's start.

    The sensor size is `size`, else the header's (`geometry`, or `width=` and `height=` of `format`).

    Raises:
        RecordingError: the header names no known encoding or no geometry, or no words follow.
    """

    kind = "Prophesee raw"

    def __init__(self, path: Path, size: tuple[int, int] | None = None) -> None:
        self.path = path
        with path.open("rb") as file:
            header = _read_header(file)
            self._data_start = file.tell()
            has_words = bool(file.read(1))
        self._encoding = _encoding(path, header)
        # Sensors whose evt2.1 words come with their 32-bit halves swapped say so by this option.
        self._halves_swapped = _format_options(header).get("endianness") == "legacy"
        self.width, self.height = size or _geometry(path, header)
        check_pixel_map(self.width, self.height)
        if not has_words:
            msg = f"{path}: empty: no events follow its header; copy the file again"
            raise RecordingError(msg)
        self.topics = (TopicInfo("events", self._encoding, encoding=self._encoding),)

    def packets(self) -> Iterator[EventMessage]:
        decoder = self._make_decoder()
        word_bytes = WORD_BYTES[self._encoding]
        with self.path.open("rb") as file:
            file.seek(self._data_start)
            while chunk := file.read(CHUNK_BYTES):
                whole = len(chunk) - len(chunk) % word_bytes
                decoded = decoder.decode(chunk[:whole], self.width, self.height)
                yield from file_packets(
                    decoded.events,
                    self._encoding,
                    triggers=decoded.triggers,
                    skipped_words=decoded.skipped_words,
                    off_sensor=decoded.off_sensor,
                )
                if whole < len(chunk):
                    msg = f"{self.path}: truncated: it ends inside a word of {word_bytes} bytes: copy the file again"
                    raise RecordingError(msg)

    def _make_decoder(self) -> WordDecoder:
        if self._encoding == "evt21":
            return Evt21Decoder(halves_swapped=self._halves_swapped)
        return Evt2Decoder() if self._encoding == "evt2" else Evt3Decoder()


def _read_header(file: BinaryIO) -> dict[str, str]:
    """Keys and values of the lines `% key value`; leaves the file at the first word."""
    header: dict[str, str] = {}
    for _ in range(HEADER_LINES_MAX):
        start = file.tell()
        line = file.readline(HEADER_LINE_MAX)
        if not line.startswith(b"%") or not line.endswith(b"\n"):
            file.seek(start)
            break
        key, _, value = line[1:].decode("utf-8", "replace").strip().partition(" ")
        if key == "end":
            break
        header[key.lower()] = value.strip()
    return header


def _encoding(path: Path, header: dict[str, str]) -> str:
    name = header.get("evt") or header.get("format", "").partition(";")[0]
    if name not in ENCODING_BY_NAME:
        found = f"encoding {name!r}" if name else "no `% evt` or `% format` line"
        msg = f"{path}: {found} in its header: known are evt 2.0, 2.1 and 3.0; is it a Prophesee recording?"
        raise RecordingError(msg)
    return ENCODING_BY_NAME[name]


def _format_options(header: dict[str, str]) -> dict[str, str]:
    """Options of a line such as `% format EVT21;height=720;width=1280;endianness=legacy`."""
    return dict(option.partition("=")[::2] for option in header.get("format", "").split(";"))


def _geometry(path: Path, header: dict[str, str]) -> tuple[int, int]:
    options = _format_options(header)
    texts = (header.get("geometry", ""), f"{options.get('width')}x{options.get('height')}")
    match = next((match for match in map(GEOMETRY.fullmatch, texts) if match), None)
    if match is None:
        msg = f"{path}: its header names no geometry: give the sensor's size with --size WIDTHxHEIGHT"
        raise RecordingError(msg)
    return int(match[1]), int(match[2])
