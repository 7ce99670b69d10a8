"""A small labelled sequence with video, written as the Event Camera Dataset is, and the cells made of it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path as FilePath

import cv2
import numpy as np

from etd_ros.datasets import LabelledSequence
from etd_ros.evaluation import TimedBox, write_boxes
from etd_ros.evaluation.cell_run import CellTask
from etd_ros.evaluation.matrix import cell_tasks
from etd_ros.events import concatenate
from etd_ros.settings import Settings
from etd_ros.simulation import Path, Scene, Sprite, Waypoint, simulate, true_boxes

WIDTH, HEIGHT, DURATION_S = 100, 80, 0.5
LABEL_S, PICTURE_S = 0.02, 0.025


def write_sequence(folder: FilePath, name: str = "square", *, video: bool = True) -> LabelledSequence:
    """A textured square that goes from left to right, in `folder/name` with its boxes.csv."""
    texture = np.kron(np.random.default_rng(7).uniform(0.3, 1.0, (6, 6)), np.ones((4, 4)))
    way = Path([Waypoint(0.0, 20, 40), Waypoint(DURATION_S, 75, 42)])
    square = Sprite("square", texture, np.ones_like(texture), way)
    scene = Scene(WIDTH, HEIGHT, DURATION_S, np.full((HEIGHT, WIDTH), 0.15), (square,))
    place = folder / name
    (place / "images").mkdir(parents=True)
    events = concatenate(list(simulate(scene, seed=3)))
    rows = zip(events.t.tolist(), events.x.tolist(), events.y.tolist(), events.p.tolist(), strict=True)
    (place / "events.txt").write_text("".join(f"{t / 1e9:.9f} {x} {y} {p}\n" for t, x, y, p in rows))
    if video:
        _write_video(place, scene, texture)
    times_s = np.arange(0.1, DURATION_S - 0.02, LABEL_S)
    labels = [TimedBox(round(time_s * 1e9), box) for time_s, box in true_boxes(scene, "square", times_s)]
    write_boxes(place / "boxes.csv", {"square": labels})
    return LabelledSequence("folder", name, place, None, {"square": labels})


def _write_video(place: FilePath, scene: Scene, texture: np.ndarray) -> None:
    lines = []
    for number, time_s in enumerate(np.arange(0.0, DURATION_S, PICTURE_S)):
        box = scene.box("square", float(time_s))
        moved = np.float64([[1, 0, box.x], [0, 1, box.y]])
        picture = np.full((HEIGHT, WIDTH), 0.15)
        cv2.warpAffine(texture, moved, (WIDTH, HEIGHT), picture, borderMode=cv2.BORDER_TRANSPARENT)
        cv2.imwrite(str(place / f"images/{number:03d}.png"), (255 * picture).astype(np.uint8))
        lines.append(f"{time_s:.9f} images/{number:03d}.png\n")
    (place / "images.txt").write_text("".join(lines))


def tasks_of(
    *sequences: LabelledSequence, systems=("etd-nr",), protocols=("one-pass",), repetitions=1
) -> list[CellTask]:
    """The cells of these sequences."""
    return cell_tasks(sequences, systems, protocols, repetitions, Settings())


def blocked_sequence(folder: FilePath, like: LabelledSequence) -> LabelledSequence:
    """A sequence whose recording is a pipe into which nobody writes: whoever reads it hangs, for certain."""
    pipe = folder / "blocked.txt"
    os.mkfifo(pipe)
    return LabelledSequence(like.dataset, "blocked", pipe, None, like.boxes)


def when_read(pipe: FilePath, act: Callable[[], None]) -> threading.Thread:
    """Act once somebody reads a pipe: opening it for writing waits for that."""

    def wait_and_act() -> None:
        with pipe.open("wb"):
            act()

    thread = threading.Thread(target=wait_and_act, daemon=True)
    thread.start()
    return thread
