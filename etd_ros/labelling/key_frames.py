"""Key frames: where a target is at the times that somebody looked at."""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from etd_ros.boxes import Box
from etd_ros.errors import EtdError
from etd_ros.names import CLASS_RULE, NAME_LENGTH_MAX, NAME_RULE, is_class, is_name
from etd_ros.output_files import write_beside

FILE_BYTES_MAX = 64 << 20


class LabellingError(EtdError):
    """Pictures that cannot be shown, or labels that cannot be made, kept or continued."""


@dataclass(frozen=True, slots=True)
class KeyFrame:
    """What somebody said of a target at one time.

    Attributes:
        stamp_ns: the time (ns), a picture's as a rule.
        box: where it is (pixels); None says that it cannot be seen from here until the next key frame.
    """

    stamp_ns: int
    box: Box | None


@dataclass(frozen=True, slots=True)
class LabelledTarget:
    """A target's labels.

    Attributes:
        key_frames: in order of time, none at the same one.
        class_id: what it is; "" if nobody said.
    """

    key_frames: tuple[KeyFrame, ...] = ()
    class_id: str = ""


Labels = Mapping[str, LabelledTarget]
"""Each target's by its name, in the order in which they were made."""


@dataclass(frozen=True, slots=True)
class KeptLabels:
    """Key frames as kept on disk.

    Attributes:
        labels: key frames and classes.
        is_saved: whether the BOXES.csv beside holds what follows from them.
        csv_digest: SHA-256 of that file when they were kept; None where there was none.
    """

    labels: Labels
    is_saved: bool
    csv_digest: str | None


def checked_name(name: str) -> str:
    """A target's name without the blanks round it.

    Raises:
        LabellingError: it breaks NAME_RULE.
    """
    name = name.strip()
    if not is_name(name):
        msg = f"target name {name[:NAME_LENGTH_MAX]!r}: give {NAME_RULE}"
        raise LabellingError(msg)
    return name


def checked_class(class_id: str) -> str:
    """A target's class without the blanks round it; it may be empty.

    Raises:
        LabellingError: it breaks CLASS_RULE.
    """
    class_id = class_id.strip()
    if not is_class(class_id):
        msg = f"class {class_id[:NAME_LENGTH_MAX]!r}: give {CLASS_RULE}"
        raise LabellingError(msg)
    return class_id


def with_key_frame(target: LabelledTarget, new: KeyFrame) -> LabelledTarget:
    """The target with a new key frame, in the place of one at the same time."""
    others = without_key_frame(target, new.stamp_ns).key_frames
    return replace(target, key_frames=tuple(sorted((*others, new), key=lambda key_frame: key_frame.stamp_ns)))


def without_key_frame(target: LabelledTarget, stamp_ns: int) -> LabelledTarget:
    """The target without the key frame at this time (ns)."""
    kept = tuple(key_frame for key_frame in target.key_frames if key_frame.stamp_ns != stamp_ns)
    return replace(target, key_frames=kept)


def digest_of(path: Path) -> str | None:
    """SHA-256 of a file in hexadecimal; None where there is no file.

    Raises:
        LabellingError: it cannot be read.
    """
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest() if path.exists() else None
    except OSError as err:
        msg = f"{path}: cannot be read ({err.strerror or err}): check its permissions"
        raise LabellingError(msg) from err


def keep(path: Path, kept: KeptLabels) -> None:
    """Write key frames as JSON, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    targets = [
        {
            "name": name,
            "class": target.class_id,
            "key_frames": [[key.stamp_ns, None if key.box is None else list(key.box)] for key in target.key_frames],
        }
        for name, target in kept.labels.items()
    ]
    content = {"is_saved": kept.is_saved, "csv_digest": kept.csv_digest, "targets": targets}
    write_beside(path, json.dumps(content, indent=1) + "\n")


def read_kept(path: Path) -> KeptLabels:
    """Key frames from `keep`.

    Raises:
        LabellingError: the file cannot be read, or was not written by `keep`.
    """
    try:
        with path.open("rb") as file:
            content = json.loads(file.read(FILE_BYTES_MAX))
        labels = {checked_name(target["name"]): _labelled_target(target) for target in content["targets"]}
        digest = content["csv_digest"]
        return KeptLabels(labels, bool(content["is_saved"]), None if digest is None else str(digest))
    except (OSError, ValueError, TypeError, LookupError, RecursionError, LabellingError) as err:
        what = f"{path}: holds no key frames that can be used ({err})"
        msg = f"{what}: mend it, or remove it to start from the labels beside it"
        raise LabellingError(msg) from err


def _labelled_target(target: Mapping[str, Any]) -> LabelledTarget:
    # Files of before there were classes have none.
    return LabelledTarget(_key_frames(target["key_frames"]), checked_class(str(target.get("class", ""))))


def _key_frames(items: Any) -> tuple[KeyFrame, ...]:
    key_frames: tuple[KeyFrame, ...] = ()
    for stamp_ns, numbers in items:
        box = None if numbers is None else Box(*(float(number) for number in numbers))
        if not 0 <= int(stamp_ns) < 2**63:
            msg = f"a stamp of {stamp_ns} ns"
            raise ValueError(msg)
        key_frames = (*key_frames, KeyFrame(int(stamp_ns), box))
    stamps = [key.stamp_ns for key in key_frames]
    if any(after <= before for before, after in itertools.pairwise(stamps)):
        msg = "key frames out of order"
        raise ValueError(msg)
    return key_frames
