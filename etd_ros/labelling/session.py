"""What is labelled: the state behind the page, with undo, and kept on disk after each change."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from etd_ros.boxes import Box, BoxError
from etd_ros.evaluation.truth import TimedBox, read_boxes, write_boxes
from etd_ros.labelling.interpolation import StampArray, boxes_at, key_frames_from, labels_from
from etd_ros.labelling.key_frames import (
    KeptLabels,
    KeyFrame,
    LabelledTarget,
    LabellingError,
    Labels,
    checked_class,
    checked_name,
    digest_of,
    keep,
    read_kept,
    with_key_frame,
    without_key_frame,
)

UNDO_MAX = 1000
TARGETS_MAX = 200


class LabelSession:
    """Labels of one recording, for any number of threads.

    Key frames are kept in `NAME.keys.json` beside `NAME.csv` after each change, so that nothing is lost when the
    program or the page ends. A session begins with them, or else with what is in the CSV.

    Args:
        stamps: the pictures' times (ns).
        width: their width (pixels).
        height: their height (pixels).
        output: the BOXES.csv.

    Attributes:
        output: the BOXES.csv.
        keys_path: where the key frames are kept.
        is_saved: whether the CSV holds what follows from the key frames.

    Raises:
        LabellingError: what was kept cannot be read, or the CSV was changed since.
        EvaluationError: the CSV cannot be read.
    """

    def __init__(self, stamps: StampArray, width: int, height: int, output: Path) -> None:
        self.output = output
        self.keys_path = output.with_suffix(".keys.json")
        self._stamps = stamps
        self._width, self._height = width, height
        self._lock = threading.Lock()
        self._csv_digest = digest_of(output)
        labels, self.is_saved = self._begin()
        self._history, self._place = [labels], 0

    def state(self) -> dict[str, Any]:
        """All that the page shows of the labels, as JSON can hold it."""
        with self._lock:
            return self._state()

    def edit(self, change: Mapping[str, Any]) -> dict[str, Any]:
        """Change the labels and keep them; returns the new state.

        Args:
            change: `action` and what belongs to it: `box` (target, picture, box), `hide` (target, picture), `clear`
                (target, key: which of its key frames), `add` (target), `rename` (target, to), `class` (target, to: ""
                for none), `delete` (target), `undo`, `redo`.

        Raises:
            LabellingError: the change makes no sense.
            OutputError: it cannot be kept.
        """
        with self._lock:
            history, place = self._moved(change)
            if history[place] != self._labels:
                self._keep(history[place], is_saved=False)
                self._history, self._place = history, place
            return self._state()

    def save(self) -> dict[str, Any]:
        """Write the CSV: a row for each picture between key frames. Returns the state with a `notice` of what is in it.

        Raises:
            LabellingError: there is no box.
            OutputError: it cannot be written.
        """
        with self._lock:
            boxes = {
                name: labels_from(target.key_frames, self._stamps, target.class_id)
                for name, target in self._labels.items()
            }
            boxes = {name: rows for name, rows in boxes.items() if rows}
            if not boxes:
                msg = "no box to save: draw one first"
                raise LabellingError(msg)
            write_boxes(self.output, boxes)
            self._csv_digest = digest_of(self.output)
            self._keep(self._labels, is_saved=True)
            rows = sum(map(len, boxes.values()))
            notice = f"{_counted(rows, 'box', 'boxes')} of {_counted(len(boxes), 'target', 'targets')} saved"
            single = [name for name, rows_of_one in boxes.items() if len(rows_of_one) < 2]
            if single:
                notice += f"; {', '.join(single)}: label at two times or more, since tracking starts from the first"
            return {**self._state(), "notice": notice}

    def _begin(self) -> tuple[Labels, bool]:
        if self.keys_path.exists():
            kept = read_kept(self.keys_path)
            if kept.csv_digest == self._csv_digest:
                return kept.labels, kept.is_saved
            if self._csv_digest is None:
                return kept.labels, False
            if not kept.is_saved:
                msg = (
                    f"{self.output}: changed since {self.keys_path.name} was kept, which has work that is not saved: "
                    "remove the one that is not wanted"
                )
                raise LabellingError(msg)
        if self._csv_digest is None:
            return {}, True
        return {checked_name(name): self._from_csv(rows) for name, rows in read_boxes(self.output).items()}, True

    def _from_csv(self, rows: Sequence[TimedBox]) -> LabelledTarget:
        class_id = next((row.class_id for row in rows if row.class_id), "")
        return LabelledTarget(key_frames_from(rows, self._stamps), checked_class(class_id))

    @property
    def _labels(self) -> Labels:
        return self._history[self._place]

    def _moved(self, change: Mapping[str, Any]) -> tuple[list[Labels], int]:
        """The history and the place in it after a change."""
        action = change.get("action")
        if action in ("undo", "redo"):
            place = self._place + (1 if action == "redo" else -1)
            if not 0 <= place < len(self._history):
                msg = f"there is nothing to {action}"
                raise LabellingError(msg)
            return self._history, place
        history = [*self._history[: self._place + 1], self._changed(str(action), change)][-UNDO_MAX:]
        return history, len(history) - 1

    def _changed(self, action: str, change: Mapping[str, Any]) -> Labels:
        labels = dict(self._labels)
        if action in ("box", "add"):
            name = checked_name(str(change.get("target", "")))
            if name not in labels and len(labels) >= TARGETS_MAX:
                msg = f"more than {TARGETS_MAX} targets: label the others in a file of their own"
                raise LabellingError(msg)
            labels.setdefault(name, LabelledTarget())
            if action == "box":
                key_frame = KeyFrame(self._stamp(change), self._box(change))
                labels[name] = with_key_frame(labels[name], key_frame)
            return labels
        name = str(change.get("target", ""))
        if name not in labels:
            msg = f"there is no target {name!r}"
            raise LabellingError(msg)
        if action == "hide":
            labels[name] = with_key_frame(labels[name], KeyFrame(self._stamp(change), None))
        elif action == "clear":
            labels[name] = without_key_frame(labels[name], _chosen(labels[name].key_frames, change).stamp_ns)
        elif action == "class":
            labels[name] = replace(labels[name], class_id=checked_class(str(change.get("to", ""))))
        elif action == "delete":
            del labels[name]
        elif action == "rename":
            new = checked_name(str(change.get("to", "")))
            if new != name and new in labels:
                msg = f"there is a target {new!r} already"
                raise LabellingError(msg)
            labels = {new if old == name else old: target for old, target in labels.items()}
        else:
            msg = f"action {action!r} is unknown"
            raise LabellingError(msg)
        return labels

    def _stamp(self, change: Mapping[str, Any]) -> int:
        index = change.get("picture")
        if not isinstance(index, int) or not 0 <= index < len(self._stamps):
            msg = f"there is no picture {index!r}"
            raise LabellingError(msg)
        return int(self._stamps[index])

    def _box(self, change: Mapping[str, Any]) -> Box:
        numbers = change.get("box")
        if not isinstance(numbers, Sequence) or len(numbers) != 4 or not all(map(_is_number, numbers)):
            msg = f"box {numbers!r} is not x, y, w, h"
            raise LabellingError(msg)
        box = Box(*map(float, numbers))
        try:
            box.check(self._width, self._height)
        except BoxError as err:
            raise LabellingError(str(err)) from err
        return box

    def _keep(self, labels: Labels, *, is_saved: bool) -> None:
        """Nothing is taken for changed that could not be kept."""
        keep(self.keys_path, KeptLabels(labels, is_saved, self._csv_digest))
        self.is_saved = is_saved

    def _state(self) -> dict[str, Any]:
        return {
            "targets": [self._target_state(name, target) for name, target in self._labels.items()],
            "is_saved": self.is_saved,
            "can_undo": self._place > 0,
            "can_redo": self._place + 1 < len(self._history),
        }

    def _target_state(self, name: str, target: LabelledTarget) -> dict[str, Any]:
        """A target as the page shows it: `at` is where a key frame lies among the pictures, whole on one."""
        numbers = np.arange(len(self._stamps))
        first_ns = self._stamps[0]
        own = np.array([key.stamp_ns for key in target.key_frames], np.int64)
        places = np.interp(own - first_ns, self._stamps - first_ns, numbers).tolist()
        rounded = boxes_at(target.key_frames, self._stamps).round(3).tolist()
        return {
            "name": name,
            "class": target.class_id,
            "keys": [{"at": at, "box": key.box} for at, key in zip(places, target.key_frames, strict=True)],
            "boxes": [None if math.isnan(box[0]) else box for box in rounded],
        }


def _chosen(key_frames: Sequence[KeyFrame], change: Mapping[str, Any]) -> KeyFrame:
    index = change.get("key")
    if not isinstance(index, int) or not 0 <= index < len(key_frames):
        msg = f"there is no key frame {index!r}"
        raise LabellingError(msg)
    return key_frames[index]


def _counted(number: int, one: str, several: str) -> str:
    return f"{number} {one if number == 1 else several}"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
