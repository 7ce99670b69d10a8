"""Where each system did worst, as pictures: what could be seen, the label, and where the system saw its target."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby

import cv2
import numpy as np
import numpy.typing as npt

from etd_ros.boxes import Box
from etd_ros.evaluation.cell_run import CellTask, Workplace
from etd_ros.evaluation.cells import CellResult
from etd_ros.evaluation.protocol import WARM_UP_NS
from etd_ros.evaluation.scoring import SUCCESS_IOU, boxes_at
from etd_ros.overlay import Picture, colour_events
from etd_ros.recordings import RecordingError
from etd_ros.recordings.loaded import LoadedRecording
from etd_ros.settings import Settings
from etd_ros.systems.pictures import PICTURES_OF_EVENTS, Given, video_pictures
from etd_ros.systems.registry import SYSTEMS

PICTURE_WIDTH = 420
LABEL_COLOUR, ANSWER_COLOUR = (90, 230, 90), (70, 70, 255)
"""Green and red: blue, green, red, as OpenCV has them."""
SHOWN_OF_EVENTS = "atsltd"
"""What the events look like where a system is not given pictures."""


@dataclass(frozen=True, slots=True)
class Failure:
    """The longest time over which a system's overlaps were all below 0.5.

    Attributes:
        result: the cell.
        first, last: indices of its labels.
    """

    result: CellResult
    first: int
    last: int

    @property
    def duration_s(self) -> float:
        """From the first label of it to the last (s)."""
        return (self.result.stamps_ns[self.last] - self.result.stamps_ns[self.first]) / 1e9


def longest_failures(results: Iterable[CellResult], count: int) -> list[Failure]:
    """The longest failures after the system's first answer, each of another target, the longest first.

    Args:
        results: of one system and protocol.
        count: how many at most.
    """
    of_targets: dict[tuple[str, str, str], Failure] = {}
    for result in results:
        target = result.cell.dataset, result.cell.sequence, result.cell.target
        for failure in _failures(result):
            of_targets[target] = max(of_targets.get(target, failure), failure, key=_length)
    return sorted(of_targets.values(), key=_length, reverse=True)[:count]


def _length(failure: Failure) -> tuple[float, int]:
    return failure.duration_s, failure.last - failure.first


def labels_before_answer(result: CellResult) -> int:
    """How many labels come before the system's first answer. They count as missed, but a system that waits for its
    first picture after the start has not failed."""
    if not result.track:
        return len(result.stamps_ns)
    return sum(stamp_ns < result.track[0].stamp_ns for stamp_ns in result.stamps_ns)


def _failures(result: CellResult) -> Iterator[Failure]:
    unanswered = labels_before_answer(result)
    answered = range(unanswered, len(result.overlaps))
    for fails, run in groupby(answered, lambda index: result.overlaps[index] < SUCCESS_IOU):
        indices = list(run)
        if fails:
            yield Failure(result, indices[0], indices[-1])


def failure_pictures(failure: Failure, task: CellTask, workplace: Workplace) -> list[tuple[str, Picture]]:
    """Where a failure begins and its middle, each as a caption and a picture, uint8, shape (h, w, 3), blue, green, red.
    Without what a system was given at the time, as before the first video frame, there is no picture.

    Raises:
        EtdError: the recording cannot be read any more.
    """
    recording = workplace.recording(task.recording, task.topic)
    origin_ns = task.labels[0].stamp_ns
    pictures = []
    for index in sorted({failure.first, (failure.first + failure.last) // 2}):
        stamp_ns = failure.result.stamps_ns[index]
        seen = seen_at(recording, failure.result.cell.system, stamp_ns, task.settings)
        if seen is not None:
            label = next(label for label in task.labels if label.stamp_ns == stamp_ns)
            (answer,) = boxes_at(failure.result.track, [label])
            caption = f"{(stamp_ns - origin_ns) / 1e9:.2f} s: overlap {failure.result.overlaps[index]:.3f}"
            pictures.append((caption + ("" if answer else ", no box"), drawn(seen, label.box, answer)))
    return pictures


def seen_at(recording: LoadedRecording, system: str, stamp_ns: int, settings: Settings) -> npt.NDArray[np.uint8] | None:
    """The last picture that a system could have been given at a time (ns): a video frame, a reconstruction, or for
    systems fed with events an ATSLTD frame. None where there is no such picture.

    Returns:
        uint8, shape (h, w), (h, w, 3), or (h, w, 2) of On and Off events.
    """
    try:
        near = recording.since(max(0, stamp_ns - WARM_UP_NS))
    except RecordingError:  # Labels may go on after the last event.
        return None
    last: Given | None = None
    for given in _given(near, system, settings):
        if given.stamp_ns > stamp_ns:
            break
        last = given
    return None if last is None else last.shown


def _given(recording: LoadedRecording, system: str, settings: Settings) -> Iterator[Given]:
    feed = SYSTEMS[system].feed
    if feed == "video":
        return video_pictures(recording.images(), recording.width, recording.height, system)
    make = PICTURES_OF_EVENTS.get(feed, PICTURES_OF_EVENTS[SHOWN_OF_EVENTS])
    return make(recording.streams(settings.stream), settings)


def drawn(seen: npt.NDArray[np.uint8], label: Box, answer: Box | None) -> Picture:
    """What was seen with the label in green and the answer in red, enlarged."""
    if seen.ndim == 2:
        picture: Picture = np.repeat(seen[:, :, None], 3, axis=2)
    else:
        picture = colour_events(seen) if seen.shape[2] == 2 else seen
    scale = PICTURE_WIDTH / picture.shape[1]
    size = PICTURE_WIDTH, max(1, round(picture.shape[0] * scale))
    enlarged = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    for box, colour in ((label, LABEL_COLOUR), (answer, ANSWER_COLOUR)):
        if box is not None:
            corners = np.array([box.x, box.y, box.x + box.w, box.y + box.h]) * scale
            left, top, right, bottom = (int(value) for value in np.clip(np.rint(corners), -(2**15), 2**15))
            cv2.rectangle(enlarged, (left, top), (right, bottom), colour, 2)
    return enlarged
