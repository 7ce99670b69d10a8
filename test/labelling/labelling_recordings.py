"""A small recording with video frames, and what labels it without a command line."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import cv2
import numpy as np

from etd_ros.labelling import LabelServer, LabelSession, make_pictures
from etd_ros.recordings import open_recording

WIDTH, HEIGHT = 80, 60
PICTURES = 11
STAMPS = [number * 100_000_000 for number in range(PICTURES)]
GREY = 60


def write_recording(folder: Path, *, with_images: bool = True) -> Path:
    """An ECD text folder of 80x60 pixels and 1 s, with 11 grey pictures that tell their number by a bright column."""
    (folder / "images").mkdir(parents=True)
    rng = np.random.default_rng(1)
    rows = zip(
        np.sort(rng.uniform(0, 1.1, 4000)), rng.integers(0, WIDTH, 4000), rng.integers(0, HEIGHT, 4000), strict=True
    )
    events = [f"{time:.6f} {x} {y} {x % 2}\n" for time, x, y in rows]
    (folder / "events.txt").write_text(f"{WIDTH} {HEIGHT}\n" + "".join(events))
    if with_images:
        for number in range(PICTURES):
            image = np.full((HEIGHT, WIDTH), GREY, np.uint8)
            image[:, 2 * number] = 200
            cv2.imwrite(str(folder / "images" / f"{number}.png"), image)
        lines = (f"{stamp_ns / 1e9:.9f} images/{number}.png\n" for number, stamp_ns in enumerate(STAMPS))
        (folder / "images.txt").write_text("".join(lines))
    return folder


@contextmanager
def serving(recording: Path, output: Path) -> Iterator[LabelServer]:
    """The page of a recording, served in a thread."""
    with open_recording(recording) as opened, make_pictures(opened) as pictures:
        session = LabelSession(pictures.stamps, pictures.width, pictures.height, output)
        with closing(LabelServer(session, pictures, title=recording.name)) as server:
            thread = threading.Thread(target=server.serve)
            thread.start()
            try:
                yield server
            finally:
                server.stop()
                thread.join()
