"""Which reader a path gets."""

from __future__ import annotations

from pathlib import Path

from etd_ros.events import EventsError, check_pixel_map
from etd_ros.recordings.interface import Recording, RecordingError

SUPPORTED = ".bag, .mcap, .db3, a ROS 2 bag's folder, .aedat4, .raw, an events.txt or its folder"


def open_recording(path: Path | str, *, topic: str | None = None, size: tuple[int, int] | None = None) -> Recording:
    """A recording of any known kind, to be used as a context manager.

    Args:
        path: ROS 1 bag, ROS 2 bag (folder or storage file), AEDAT4, Prophesee raw, ECD text or its folder.
        topic: the event topic, where a bag has several.
        size: sensor (width, height) in pixels, for text and raw files that do not tell it.

    Raises:
        RecordingError: missing, empty, unreadable, damaged, of an unknown kind, or without (one choice of) events; or
            a bag or AEDAT4 file, which tell the sensor's size themselves, beside a `size`.
        EventsError: `size` is impossible.
    """
    path = Path(path)
    if size is not None:
        check_pixel_map(*size)
    try:
        return _open(path, topic, size)
    except OSError as err:
        msg = f"{path}: cannot be read ({err.strerror or err}): check its permissions"
        raise RecordingError(msg) from err
    except EventsError as err:
        msg = f"{path}: {err}: give the sensor's own with --size WIDTHxHEIGHT, or copy the file again"
        raise RecordingError(msg) from err


def _open(path: Path, topic: str | None, size: tuple[int, int] | None) -> Recording:
    # The readers are imported where they are used: a ROS bag needs no AEDAT4 package, and start-up stays short.
    if not path.exists():
        msg = f"{path}: no such file or folder: check the path"
        raise RecordingError(msg)
    if path.is_file() and path.stat().st_size == 0:
        msg = f"{path}: empty: record or copy it again"
        raise RecordingError(msg)
    suffix = path.suffix
    if (path.is_dir() and (path / "events.txt").is_file()) or suffix == ".txt":
        from etd_ros.recordings.ecd import EcdRecording

        return EcdRecording(path, size)
    if suffix == ".raw":
        from etd_ros.recordings.prophesee import PropheseeRecording

        return PropheseeRecording(path, size)
    is_bag = path.is_dir() or suffix in (".bag", ".mcap", ".db3")
    if size is not None and (is_bag or suffix == ".aedat4"):
        msg = f"{path}: bags and AEDAT4 tell the sensor's size themselves: leave --size out, which is for text and .raw"
        raise RecordingError(msg)
    if is_bag:
        from etd_ros.recordings.rosbag import RosBagRecording

        return RosBagRecording(path, topic)
    if suffix == ".aedat4":
        from etd_ros.recordings.aedat4 import Aedat4Recording

        return Aedat4Recording(path)
    msg = f"{path}: unknown kind of recording ({path.suffix or 'no extension'}): supported are {SUPPORTED}"
    raise RecordingError(msg)
