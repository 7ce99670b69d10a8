"""What the columns of a box file mean: a reading of them that the user names, or that is found by trying."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from etd_ros.boxes import Box
from etd_ros.datasets.box_text import BoxText
from etd_ros.datasets.interface import DatasetError
from etd_ros.datasets.spans import Span, nanoseconds
from etd_ros.evaluation.truth import TimedBox

CORNERS, SIZED, CENTRED = "x1 y1 x2 y2", "x y w h", "cx cy w h"
TIMES = ("t", "frame0", "frame1")
WORDS = (*TIMES, "id", *CORNERS.split(), "cx", "cy", *SIZED.split(), "-")
UNITS_NS = {"s": 10**9, "us": 10**3, "ns": 1}
LAYOUTS: Mapping[int, Sequence[str]] = {
    5: [f"{time} {box}" for time in TIMES for box in (CORNERS, SIZED)],
    6: [
        layout
        for box in (CORNERS, SIZED)
        for layout in (f"- t {box}", f"t id {box}", f"t {box} id", f"frame0 id {box}", f"frame1 id {box}")
    ],
    7: [f"- t id {box}" for box in (CORNERS, SIZED)],
}
"""Readings that are tried, by the number of columns."""

OFF_FRAME_PX = 5.0
"""How far a hand-drawn box may reach over the frame's border."""
SPACING_NS_MIN = 1_000_000
"""Nobody labels more often than once in a millisecond: closer times are frame numbers or other units."""
OBJECTS_MAX = 100
STEADIER = 2.0
"""By how much the sizes of one reading must be steadier than another's to be preferred."""

ImageStamps = Callable[[], Sequence[int]]
"""Gives the stamps (ns) of a recording's video frames, when a file counts by them."""


class UnnamedObjectsError(DatasetError):
    """Several boxes at one time, and no column that says which object is which."""


@dataclass(frozen=True, slots=True)
class _Reading:
    """Boxes of each object in order of time, as one reading of the columns has them."""

    layout: str
    boxes: Mapping[str, Sequence[TimedBox]]

    def size_change(self) -> float:
        """Mean change of the logarithms of width and height from each label to the object's next."""
        changes = [
            abs(math.log(after.box.w / before.box.w)) + abs(math.log(after.box.h / before.box.h))
            for boxes in self.boxes.values()
            for before, after in itertools.pairwise(boxes)
        ]
        return fmean(changes) if changes else math.inf


def read_columns(
    text: BoxText,
    span: Span,
    image_stamps: ImageStamps,
    columns: str | None = None,
    tell: Callable[[str], None] | None = None,
) -> dict[str, list[TimedBox]]:
    """The labels of a box file by object: `object`, or `object_ID` where a column numbers them.

    Args:
        text: the file's numbers.
        span: of the recording, whose clock and frame the labels must fit.
        image_stamps: stamps of the recording's video frames (ns).
        columns: what each column is, as words: `t` (time in s, us or ns), `frame0` or `frame1` (number of a video
            frame from 0 or 1), `id`, `x1 y1 x2 y2` (opposite corners), `x y w h` (top-left corner and size, pixels) or
            `cx cy w h` (centre and size), `-` (passed over). None tries the usual ones, of which the last one is none:
            the numbers must lie on the frame and within the recording, and where several readings do, the sizes of one
            must be twice as steady as the next one's.
        tell: called with one line that says which reading was found.

    Raises:
        DatasetError: no reading makes sense, or several make the same; `columns` has other words, or does not fit.
        UnnamedObjectsError: several boxes at one time that no column tells apart.
    """
    if columns is not None:
        reading = _read(text, " ".join(_checked_words(columns)), span, image_stamps)
    else:
        reading = _detect(text, span, image_stamps)
    for name, boxes in reading.boxes.items():
        for before, after in itertools.pairwise(boxes):
            if before.stamp_ns == after.stamp_ns:
                msg = (
                    f"{text.path}: two boxes of {name!r} at {after.stamp_ns} ns, and no column says which object is "
                    "which: write them as target,stamp_ns,x,y,w,h to a boxes.csv beside it"
                )
                raise UnnamedObjectsError(msg)
    if columns is None and tell is not None:
        tell(f"{text.path}: read as '{reading.layout}'; if that is wrong, name the columns with --box-columns")
    return {name: list(boxes) for name, boxes in reading.boxes.items()}


def _checked_words(columns: str) -> list[str]:
    words = columns.split()
    unknown = [word for word in words if word not in WORDS]
    named = [word for word in words if word != "-"]
    is_whole = sum(word in TIMES for word in words) == 1 and any(
        set(named) - set(TIMES) - {"id"} == set(box.split()) for box in (CORNERS, SIZED, CENTRED)
    )
    if unknown or not is_whole or len(set(named)) < len(named):
        problem = f"has the unknown word {unknown[0]!r}" if unknown else "does not say time and box once each"
        msg = f"columns {columns!r} {problem}: give words such as 't {CORNERS}', of {' '.join(WORDS)}"
        raise DatasetError(msg)
    return words


def _detect(text: BoxText, span: Span, image_stamps: ImageStamps) -> _Reading:
    readings, misfits = [], []
    for layout in LAYOUTS.get(text.columns, ()):
        try:
            readings.append(_read(text, layout, span, image_stamps))
        except DatasetError as err:
            misfits.append(str(err))
    if not readings:
        why = "; ".join(misfits[:2]) or f"{text.path}: {text.columns} columns"
        msg = f"{why}; no other reading of the columns fits either: name them with --box-columns 't {CORNERS}'"
        raise DatasetError(msg)
    readings.sort(key=_Reading.size_change)
    best = readings[0]
    rivals = [other for other in readings[1:] if best.size_change() * STEADIER >= other.size_change()]
    if rivals:
        fitting = " and ".join(f"'{reading.layout}'" for reading in (best, *rivals))
        msg = f"{text.path}: the columns {fitting} fit equally well: say which with --box-columns"
        raise DatasetError(msg)
    return best


def _read(text: BoxText, layout: str, span: Span, image_stamps: ImageStamps) -> _Reading:
    """Read the file in one way.

    Raises:
        DatasetError: the numbers do not fit it.
    """
    words = layout.split()
    if len(words) != text.columns:
        msg = f"{text.path}: {text.columns} columns do not fit '{layout}': name each, '-' for one to pass over"
        raise DatasetError(msg)
    cells = [dict(zip(words, row, strict=True)) for row in text.rows]
    try:
        stamps = _stamps([row.get("t", "") for row in cells], span) if "t" in words else None
        if stamps is None:
            word = next(word for word in words if word in TIMES)
            stamps = _frame_stamps([_whole(row[word]) for row in cells], image_stamps(), int(word[-1]))
        names = _names([row["id"] for row in cells]) if "id" in words else ["object"] * len(cells)
        boxes: dict[str, list[TimedBox]] = {}
        for line, row, stamp_ns, name in zip(text.lines, cells, stamps, names, strict=True):
            box = _box(row, line)
            if box is not None:
                _check_on_frame(box, span, line)
                boxes.setdefault(name, []).append(TimedBox(stamp_ns, box))
        for labels in boxes.values():
            labels.sort(key=lambda label: label.stamp_ns)
    except ValueError as err:
        msg = f"{text.path}: read as '{layout}', {err}"
        raise DatasetError(msg) from err
    if not boxes:
        msg = f"{text.path}: holds no box"
        raise DatasetError(msg)
    return _Reading(layout, boxes)


def _stamps(texts: Sequence[str], span: Span) -> list[int]:
    """Times in the one unit in which they lie within the recording, as far apart as labels are."""
    for unit_ns in UNITS_NS.values():
        stamps = [nanoseconds(text, unit_ns) for text in texts if _is_in_range(text, unit_ns)]
        if len(stamps) == len(texts) and all(span.holds(stamp_ns) for stamp_ns in stamps) and _are_apart(stamps):
            return stamps
    msg = f"its times ({texts[0]} to {texts[-1]}) are not those of labels within {span} in any of {', '.join(UNITS_NS)}"
    raise ValueError(msg)


def _are_apart(stamps: Sequence[int]) -> bool:
    times = sorted(set(stamps))
    is_one = len(times) == 1 and len(stamps) > 1
    return not is_one and all(after - before >= SPACING_NS_MIN for before, after in itertools.pairwise(times))


def _is_in_range(text: str, unit_ns: int) -> bool:
    return 0 <= float(text) * unit_ns < 2**62


def _frame_stamps(numbers: Sequence[int], image_stamps: Sequence[int], first: int) -> list[int]:
    if min(numbers) < first or max(numbers) >= first + len(image_stamps):
        msg = f"frame numbers from {min(numbers)} to {max(numbers)} do not fit {len(image_stamps)} images"
        raise ValueError(msg)
    return [image_stamps[number - first] for number in numbers]


def _names(texts: Sequence[str]) -> list[str]:
    numbers = [_whole(text) for text in texts]
    if len(set(numbers)) > OBJECTS_MAX:
        msg = f"{len(set(numbers))} different ids are more objects than anybody labels ({OBJECTS_MAX})"
        raise ValueError(msg)
    return [f"object_{number}" for number in numbers]


def _whole(text: str) -> int:
    value = float(text)
    if not value.is_integer() or abs(value) > 2**53:
        msg = f"{text} is no whole number"
        raise ValueError(msg)
    return int(value)


def _box(row: Mapping[str, str], line: int) -> Box | None:
    """The box (pixels); None for a point, or two pixels in a row, which say that the object cannot be seen."""
    if "cx" in row:
        cx, cy, w, h = (float(row[word]) for word in CENTRED.split())
        x, y = cx - w / 2, cy - h / 2
    elif "w" in row:
        x, y, w, h = (float(row[word]) for word in SIZED.split())
    else:
        x1, y1, x2, y2 = (float(row[word]) for word in CORNERS.split())
        x, y, w, h = min(x1, x2), min(y1, y2), abs(x2 - x1), abs(y2 - y1)
    if w * h == 0 and max(w, h) <= 1:
        return None
    if w < 1 or h < 1:
        msg = f"line {line} has a box of {w:g} x {h:g} pixels"
        raise ValueError(msg)
    return Box(x, y, w, h)


def _check_on_frame(box: Box, span: Span, line: int) -> None:
    right, bottom = span.width + OFF_FRAME_PX, span.height + OFF_FRAME_PX
    if box.x < -OFF_FRAME_PX or box.y < -OFF_FRAME_PX or box.x + box.w > right or box.y + box.h > bottom:
        msg = f"line {line} reaches over the border of the {span.width}x{span.height} frame"
        raise ValueError(msg)
