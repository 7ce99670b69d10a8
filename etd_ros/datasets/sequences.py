"""Which recordings a dataset's folder holds, and which of them are the same sequence."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from etd_ros.datasets.interface import DatasetError

DEPTH_MAX = 5
FOLDERS_MAX = 10_000
FILE_SUFFIXES = (".bag", ".mcap", ".db3", ".aedat4", ".raw")
"""Recordings that are files, the preferred container first."""
STORAGE_SUFFIXES = (".mcap", ".db3")
"""Files that are parts of a ROS 2 bag where a metadata.yaml lies beside them."""


@dataclass(frozen=True, slots=True)
class FoundSequence:
    """A sequence, with or without labels.

    Attributes:
        name: unique within the dataset.
        recordings: the same recording in one container or several, the preferred one first.
        stem: path without suffix of what the sequence is named after.
        folder: where files may lie that are its own, under names that do not tell: a folder that holds nothing else.
    """

    name: str
    recordings: tuple[Path, ...]
    stem: Path
    folder: Path | None

    def companions(self, name: str) -> list[Path]:
        """The files of this name that belong to it: SEQUENCE.name beside it, or name in its own folder."""
        places = {self.stem.with_name(f"{self.stem.name}.{name}"), self.stem / name}
        if self.folder is not None:
            places.add(self.folder / name)
        return sorted(place for place in places if place.is_file())

    def object_texts(self) -> dict[str, Path]:
        """Files NAME_OBJECT.txt beside it or in its own folder, by the object's name in lower case."""
        pattern = re.compile(rf"{re.escape(self.stem.name)}_([A-Z][A-Z0-9]*)\.txt")
        places = [path for folder in (self.stem.parent, self.stem) for path in sorted(folder.glob("*.txt"))]
        return {match[1].lower(): path for path in places if (match := pattern.fullmatch(path.name))}


def find_sequences(root: Path) -> list[FoundSequence]:
    """The sequences in a folder and the folders below it, by name.

    A folder with an events.txt, or with a ROS 2 bag's metadata.yaml, is one sequence, whatever else lies in it. Other
    recordings are a sequence each, except that what differs in the suffix alone is the same sequence: `a.bag`,
    `a.aedat4` and the folder `a` are one.

    A sequence is named by as many folders and files of its path as it takes to tell it from the others, less the
    folders that all share: `slider_depth/slider_depth.bag` is `slider_depth`, and one of several files in the folder
    `balls` is `balls-NAME`.

    Raises:
        DatasetError: no folder, unreadable, too many folders, or two sequences of one name.
    """
    if not root.is_dir():
        what = "is a file" if root.exists() else "no such folder"
        msg = f"{root}: {what}: name the folder that holds the dataset's recordings"
        raise DatasetError(msg)
    # Label files are found by the folder's name, which "." and ".." do not tell.
    root = root if root.name not in ("", "..") else root.resolve()
    try:
        by_stem = _recordings_by_stem(root)
    except OSError as err:
        msg = f"{err.filename or root}: cannot be read ({err.strerror or err}): check its permissions"
        raise DatasetError(msg) from err
    names = _names(root, list(by_stem))
    found = [
        FoundSequence(names[stem], tuple(sorted(recordings, key=_preference)), stem, _own_folder(stem, by_stem))
        for stem, recordings in by_stem.items()
    ]
    return sorted(found, key=lambda sequence: sequence.name)


def find_archives(root: Path) -> list[Path]:
    """Zip files directly in a folder that have not been unpacked into a folder of their name."""
    return sorted(path for path in root.glob("*.zip") if path.is_file() and not path.with_suffix("").is_dir())


def _recordings_by_stem(root: Path) -> dict[Path, list[Path]]:
    by_stem: dict[Path, list[Path]] = {}
    for folder in _folders(root):
        for stem, recording in _recordings_in(folder):
            by_stem.setdefault(stem, []).append(recording)
    return by_stem


def _folders(root: Path) -> Iterator[Path]:
    """The folder and those below it; what lies in a sequence's own folder, such as its images, is not looked at."""
    seen: set[Path] = set()
    waiting = [(root, 0)]
    while waiting:
        folder, depth = waiting.pop()
        # Links may lead in circles.
        if folder.resolve() in seen:
            continue
        seen.add(folder.resolve())
        if len(seen) > FOLDERS_MAX:
            msg = f"{root}: more than {FOLDERS_MAX} folders: name the folder that holds the dataset alone"
            raise DatasetError(msg)
        yield folder
        if depth < DEPTH_MAX and not _is_recording(folder):
            with os.scandir(folder) as entries:
                waiting += [(folder / item.name, depth + 1) for item in entries if item.is_dir() and _is_visible(item)]


def _recordings_in(folder: Path) -> Iterator[tuple[Path, Path]]:
    """(stem, recording) of the folder itself and of the files in it."""
    is_recording = _is_recording(folder)
    if is_recording:
        yield folder, folder
    is_bag = is_recording and not _has_text(folder)
    for path in sorted(folder.iterdir()):
        is_part = is_bag and path.suffix in STORAGE_SUFFIXES
        if path.suffix in FILE_SUFFIXES and path.is_file() and not path.name.startswith(".") and not is_part:
            yield (folder if is_recording else path.with_suffix("")), path


def _is_recording(folder: Path) -> bool:
    return _has_text(folder) or (folder / "metadata.yaml").is_file()


def _has_text(folder: Path) -> bool:
    return (folder / "events.txt").is_file()


def _is_visible(entry: os.DirEntry[str]) -> bool:
    return not entry.name.startswith((".", "__"))


def _own_folder(stem: Path, by_stem: Iterable[Path]) -> Path | None:
    """The folder round a recording, if there is no other sequence in it."""
    return stem.parent if all(other == stem or other.parent != stem.parent for other in by_stem) else None


def _preference(recording: Path) -> tuple[int, str]:
    """Bags first, since what they hold is complete; text last, since it is slow to read."""
    if recording.is_dir():
        return (len(FILE_SUFFIXES) if _has_text(recording) else 0), recording.name
    return FILE_SUFFIXES.index(recording.suffix), recording.name


def _names(root: Path, stems: Sequence[Path]) -> dict[Path, str]:
    if stems == [root]:
        return {root: root.resolve().name}
    shared = root
    if len(stems) > 1:
        shared = Path(os.path.commonpath([stem.parent for stem in stems]))
    parts = {stem: stem.relative_to(shared).parts for stem in stems}
    names = {stem: "-".join(_telling_part(own, list(parts.values()))) for stem, own in parts.items()}
    for stem, name in names.items():
        if list(names.values()).count(name) > 1:
            msg = f"{stem}: a second sequence would be called {name!r}: rename it"
            raise DatasetError(msg)
    return names


def _telling_part(parts: tuple[str, ...], all_parts: Sequence[tuple[str, ...]]) -> tuple[str, ...]:
    """The shortest beginning that no other path has."""
    for length in range(1, len(parts)):
        if sum(other[:length] == parts[:length] for other in all_parts) == 1:
            return parts[:length]
    return parts
