"""Measures ECO and OpenCV's CSRT on the video of labelled recordings: the table of docs/eco.md.

usage: python docs/eco_measures.py RECORDING BOXES.csv [RECORDING BOXES.csv ...]
"""

import sys
import time
from pathlib import Path

import cv2
import numpy as np

from etd_ros.boxes import Box
from etd_ros.evaluation import read_boxes
from etd_ros.evaluation.truth import TimedBox
from etd_ros.recordings import open_recording
from etd_ros.systems.eco import EcoTracker
from etd_ros.systems.interface import Answer, Picture


class Csrt:
    """OpenCV's CSRT with its default parameters."""

    def start(self, picture: Picture, box: Box) -> None:
        """Make a new tracker for a box, which CSRT takes in whole pixels."""
        self._tracker = cv2.TrackerCSRT_create()
        self._tracker.init(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), tuple(round(value) for value in box))

    def update(self, picture: Picture) -> Answer:
        """Its box in the next picture."""
        found, box = self._tracker.update(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
        return Answer(Box(*map(float, box)) if found else None, float("nan"))


def labelled(pictures: list[tuple[int, Picture]], labels: list[TimedBox]) -> list[tuple[Picture, Box]]:
    """The pictures from the first to the last label, each with its label, interpolated."""
    stamps = np.array([label.stamp_ns for label in labels])
    boxes = np.array([label.box for label in labels])
    inside = [(stamp, picture) for stamp, picture in pictures if stamps[0] <= stamp <= stamps[-1]]
    # Differences, because times as floating-point numbers of today are whole microseconds.
    at = [
        Box(*(float(np.interp(stamp - stamps[0], stamps - stamps[0], side)) for side in boxes.T)) for stamp, _ in inside
    ]
    return [(picture, box) for (_, picture), box in zip(inside, at, strict=True)]


def measure(tracker: EcoTracker | Csrt, steps: list[tuple[Picture, Box]]) -> str:
    """Mean IoU and success from the second picture on, and median and largest processor time of a picture (ms)."""
    tracker.start(*steps[0])
    overlaps, times_ms = [], []
    for picture, box in steps[1:]:
        begin = time.process_time()
        answer = tracker.update(picture)
        times_ms.append(1e3 * (time.process_time() - begin))
        overlaps.append(answer.box.iou(box) if answer.box else 0.0)
    success = np.mean(np.array(overlaps) >= 0.5)
    return f"{np.mean(overlaps):.3f} / {success:.3f} | {np.median(times_ms):.1f} ({np.max(times_ms):.1f})"


def main() -> None:
    """A row for each target of each recording."""
    cv2.setNumThreads(1)
    for recording, boxes in zip(sys.argv[1::2], sys.argv[2::2], strict=True):
        with open_recording(Path(recording)) as opened:
            pictures = [(image.stamp_ns, np.asarray(image.data, np.uint8)) for image in opened.images()]
        for name, labels in read_boxes(Path(boxes)).items():
            steps = labelled(pictures, labels)
            measure(EcoTracker(), steps[:3])  # compiles its kernels
            row = [measure(tracker, steps) for tracker in (EcoTracker(), Csrt())]
            width, height = round(labels[0].box.w), round(labels[0].box.h)
            sys.stdout.write(f"| {name} | {width}x{height} | {len(steps) - 1} | {' | '.join(row)} |\n")


if __name__ == "__main__":
    main()
