"""What labels are held against: when a recording starts and ends, and how large its pictures are."""

from __future__ import annotations

import os
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from etd_ros.datasets.interface import DatasetError
from etd_ros.recordings import Recording, open_recording
from etd_ros.targets import EARLIEST_START_NS

SLACK_NS = EARLIEST_START_NS
"""How far labels may lie outside the events' time: a scene without motion makes none at the start or the end."""
TAIL_BYTES = 4096


@dataclass(frozen=True, slots=True)
class Span:
    """A recording's time and size.

    Attributes:
        recording: the file or folder.
        first_ns: the first event's time (ns), on the clock that `events` gives.
        last_ns: about when it ends (ns); None where the container does not tell without being read through.
        width, height: sensor size (pixels).
    """

    recording: Path
    first_ns: int
    last_ns: int | None
    width: int
    height: int

    def holds(self, stamp_ns: int) -> bool:
        """Whether a label may have this stamp (ns)."""
        return self.first_ns - SLACK_NS <= stamp_ns and (self.last_ns is None or stamp_ns <= self.last_ns + SLACK_NS)

    def __str__(self) -> str:
        return f"{self.recording} ({self.first_ns} to {'its end' if self.last_ns is None else f'{self.last_ns}'} ns)"


def span_of(path: Path) -> Span:
    """The span of a recording, from its beginning and its end alone.

    Raises:
        RecordingError: it cannot be opened, or is damaged at its beginning.
        DatasetError: it holds no event, or its text does not end with one.
    """
    with open_recording(path) as recording:
        first = next((batch for batch in recording.events() if len(batch)), None)
        if first is None:
            msg = f"{path}: holds no event: record or copy it again"
            raise DatasetError(msg)
        first_ns = int(first.t[0])
        return Span(path, first_ns, _last_ns(recording, first_ns), recording.width, recording.height)


def _last_ns(recording: Recording, first_ns: int) -> int | None:
    text = recording.path / "events.txt" if recording.path.is_dir() else recording.path
    if text.name == "events.txt" and text.is_file():
        return _last_text_ns(text)
    return None if recording.duration_ns is None else first_ns + recording.duration_ns


def _last_text_ns(text: Path) -> int:
    """Time of the last line `t x y p` (ns)."""
    with text.open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - TAIL_BYTES))
        lines = file.read(TAIL_BYTES).split(b"\n")
    last = next((line for line in reversed(lines) if line.strip()), b"")
    try:
        return nanoseconds(last.split()[0].decode("ascii"), 10**9)
    except (IndexError, UnicodeDecodeError, ValueError) as err:
        msg = f"{text}: its last line ({last[:60].decode('ascii', 'replace')!r}) is not `t x y p`: copy it again"
        raise DatasetError(msg) from err


def nanoseconds(text: str, unit_ns: int) -> int:
    """A decimal number of units as whole nanoseconds, exactly: a float would lose some on today's epoch.

    Raises:
        ValueError: no decimal number, or out of range.
    """
    try:
        stamp_ns = Decimal(text) * unit_ns
    except ArithmeticError as err:
        msg = f"{text!r} is no number in range"
        raise ValueError(msg) from err
    if not stamp_ns.is_finite() or not 0 <= stamp_ns < 2**63:
        msg = f"{text} is out of range"
        raise ValueError(msg)
    return round(stamp_ns)
