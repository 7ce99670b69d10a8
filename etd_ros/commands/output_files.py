"""Files that a command writes: refused before the work where they cannot be, and whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from etd_ros.errors import EtdError


class OutputError(EtdError):
    """An output that cannot be written."""


def check_outputs(*outputs: Path | None) -> None:
    """Refuse files that cannot be written, before the work rather than after it.

    Raises:
        OutputError: an output is no regular file, two are the same, or a folder is missing or not writable.
    """
    named = [output for output in outputs if output is not None]
    for output in named:
        if output.exists() and not output.is_file():
            kind = "a folder" if output.is_dir() else "no regular file"
            msg = f"{output}: cannot be written (is {kind}): name a file"
            raise OutputError(msg)
        if not os.access(output.parent, os.W_OK):
            msg = f"{output}: cannot be written: name a file in a folder that exists and that you may write"
            raise OutputError(msg)
    if len({output.resolve() for output in named}) < len(named):
        msg = f"{named[0]}: two outputs have one name: name them apart"
        raise OutputError(msg)


def write_beside(path: Path, content: bytes) -> None:
    """Write a file under a temporary name beside its own, then rename it.

    Raises:
        OutputError: the file cannot be written.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.write_bytes(content)
        partial.replace(path)
    except OSError as err:
        msg = f"{path}: cannot be written ({err.strerror or err}): name a file in a folder you may write"
        raise OutputError(msg) from err
    finally:
        partial.unlink(missing_ok=True)
