"""Where compiled kernels are kept when the package was installed read-only and its user has no home."""

from __future__ import annotations

import os
import stat
import tempfile
from pathlib import Path

CACHE_VARIABLE = "NUMBA_CACHE_DIR"
PACKAGE = Path(__file__).resolve().parent


def choose_kernel_cache() -> None:
    """Give the compiler a folder of the user's own where it has none. Call it before any kernel is defined.

    The compiler keeps kernels beside their sources, or else in the user's cache folder, and refuses to work at all
    where it can write to neither, as in many containers. A temporary folder is the last resort.
    """
    if CACHE_VARIABLE in os.environ or _is_writable(PACKAGE) or _is_writable(_user_cache()):
        return
    os.environ[CACHE_VARIABLE] = str(_temporary_cache(Path(tempfile.gettempdir())))


def _user_cache() -> Path:
    # A user without a home leaves "~" as it is.
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "numba"  # noqa: PTH111


def _is_writable(folder: Path) -> bool:
    if not folder.is_absolute():
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _temporary_cache(parent: Path) -> Path:
    """A folder that outlives the process, unless somebody else could have put code into it for us to run."""
    folder = parent / f"etd_ros_kernels_{os.getuid()}"
    if not folder.is_symlink() and not folder.exists():
        folder.mkdir(mode=0o700, exist_ok=True)
    found = folder.lstat()
    is_private = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and not found.st_mode & 0o022
    return folder if is_private else Path(tempfile.mkdtemp(dir=parent))
