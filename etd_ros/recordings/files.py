"""Which files a recording is read from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

IMAGE_LIST = "images.txt"
TEXT_SUFFIX = ".txt"
READ = ("events.txt", "metadata.yaml", "*.mcap", "*.db3", "*.mcap.zstd", "*.db3.zstd")
"""What there may be in a recording's folder, in patterns: the text format's beside its pictures, and a ROS 2 bag's."""


def recording_files(path: Path) -> list[Path]:
    """What is read of a recording. Labels and results may lie in its folder, too."""
    if path.is_dir():
        found, images = {file for pattern in READ for file in path.glob(pattern)}, path / IMAGE_LIST
    elif path.suffix == TEXT_SUFFIX:
        found, images = {path}, path.with_name(IMAGE_LIST)
    else:
        return [path]
    # A line that is not `t file` is the reader's to refuse.
    frames = (images.parent / fields[-1] for _, fields in image_lines(images))
    return sorted(file for file in (*found, images, *frames) if is_file(file))


def is_file(path: Path) -> bool:
    """Whether it is one; a name that no file can have is the reader's to refuse."""
    try:
        return path.is_file()
    except OSError:
        return False


def image_lines(index: Path) -> Iterator[tuple[int, list[str]]]:
    """Number, from 1, and words of each line of an images.txt that is not blank; none where there is no such file."""
    if index.is_file():
        with index.open(encoding="utf-8", errors="replace") as file:
            yield from ((number, fields) for number, line in enumerate(file, 1) if (fields := line.split()))
