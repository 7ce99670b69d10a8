"""Files that are written whole or not at all, and refused before the work where they cannot be."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any, TextIO

from etd_ros.errors import EtdError


class OutputError(EtdError):
    """An output that cannot be written."""


def check_outputs(*outputs: Path | None, inputs: Iterable[Path | None] = ()) -> None:
    """Refuse files that cannot be written, before the work rather than after it; None is passed over.

    Raises:
        OutputError: an output is no regular file, two are the same, one is an input as well, or a folder is missing or
            not writable.
    """
    named = [output for output in outputs if output is not None]
    for output in named:
        _check_regular(output)
        if not (output.parent.is_dir() and os.access(output.parent, os.W_OK)):
            msg = f"{output}: cannot be written: name a file in a folder that exists and that you may write"
            raise OutputError(msg)
    if len({output.resolve() for output in named}) < len(named):
        msg = f"{named[0]}: two outputs have one name: name them apart"
        raise OutputError(msg)
    read = {path.resolve() for path in inputs if path is not None}
    for output in named:
        if output.resolve() in read:
            msg = f"{output}: is read, and would be overwritten: name the output otherwise"
            raise OutputError(msg)


def check_pictures(*pictures: Path | None) -> None:
    """Refuse names that promise another format than PNG, which is what is written; None is passed over.

    Raises:
        OutputError: a name does not end in .png.
    """
    for picture in pictures:
        if picture is not None and picture.suffix.lower() != ".png":
            msg = f"{picture}: pictures are PNG files: name it something.png"
            raise OutputError(msg)


def make_folder(folder: Path, output: Path | None = None) -> None:
    """Have a folder for results, and those above it, before the work rather than after it; `output` is what was asked
    for, if that lies in it.

    Raises:
        OutputError: it or one above it is no folder, or it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as err:
        strangers = [place for place in (folder, *folder.parents) if os.path.lexists(place) and not place.is_dir()]
        reason = f"{strangers[0]} is no folder" if strangers else err.strerror or err
        what = f"{folder}: cannot be made a folder" if output is None else f"{output}: cannot be made there"
        msg = f"{what} ({reason}): name one that you may write, or a new one"
        raise OutputError(msg) from err


def check_folder(folder: Path) -> None:
    """Refuse a folder in which no file can be made.

    Raises:
        OutputError: it is one.
    """
    try:
        with TemporaryFile(dir=folder):
            pass
    except OSError as err:
        msg = f"{folder}: cannot be written to ({err.strerror or err}): name a folder where you may write"
        raise OutputError(msg) from err


def write_beside(path: Path, content: bytes | str) -> None:
    """Write a file, text as UTF-8, under a temporary name beside its own, then rename it.

    Raises:
        OutputError: the file cannot be written.
    """
    with renamed_at_the_end(path) as partial, partial.open("wb") as file:
        file.write(content.encode() if isinstance(content, str) else content)
        _bring_to_disk(file)


@contextmanager
def written_beside(path: Path, *, outlives_power: bool = True) -> Iterator[TextIO]:
    """A UTF-8 text file under a temporary name, lines ended as they are written, that gets its own name only when the
    block succeeds.

    Args:
        path: of the file.
        outlives_power: whether it shall be whole after a power cut, too. Waiting for the disk is some milliseconds, or
            seconds where something else writes much to it.

    Raises:
        OutputError: the file cannot be written.
    """
    with renamed_at_the_end(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        yield file
        if outlives_power:
            _bring_to_disk(file)


@contextmanager
def renamed_at_the_end(path: Path) -> Iterator[Path]:
    """A temporary name beside a file's own; what is written there is renamed when the block succeeds, else removed.

    Raises:
        OutputError: the file cannot be written.
    """
    _check_regular(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield partial
        partial.replace(path)
    except OSError as err:
        msg = f"{path}: cannot be written ({err.strerror or err}): name a file in a folder you may write"
        raise OutputError(msg) from err
    finally:
        if partial.is_file():
            partial.unlink()


def _bring_to_disk(file: IO[Any]) -> None:
    """Before it is renamed: a disk may write the new name before the content, and lose power in between."""
    file.flush()
    os.fsync(file.fileno())


def _check_regular(path: Path) -> None:
    """Renaming would put a file in the place of a device or a pipe."""
    if path.exists() and not path.is_file():
        kind = "a folder" if path.is_dir() else "no regular file"
        msg = f"{path}: cannot be written (is {kind}): name a file"
        raise OutputError(msg)
