"""Message definitions of installed interface packages, for bags that record them."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def interface_definitions(packages: tuple[str, ...]) -> dict[str, str]:
    """The text of every message of the packages, by type name.

    They lie under the prefixes that a sourced ROS 2 names, or, where ROS came through pip, in this environment.
    """
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]
    return {
        f"{package}/msg/{file.stem}": file.read_text(encoding="utf-8")
        for package in packages
        for prefix in reversed(prefixes)
        for file in sorted((Path(prefix) / "share" / package / "msg").glob("*.msg"))
    }
