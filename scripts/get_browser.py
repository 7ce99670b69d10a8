"""Chromium and its driver for the tests of the labelling page: `python3 scripts/get_browser.py`, or `make browser`.

Installs the Debian packages when run as root where apt-get is; otherwise says what is missing. Does nothing when both
are there. Uses nothing but the standard library.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys

PROGRAMS = {"chromium": "chromium", "chromedriver": "chromium-driver"}
"""Programs that the tests start, and the Debian packages that hold them."""


def main() -> int:
    """Bring what is missing; exit code 1 with a message on standard error if that cannot be done."""
    packages = [package for program, package in PROGRAMS.items() if not shutil.which(program)]
    if not packages:
        return 0
    how = f"install {' and '.join(packages)}, or put chromium and chromedriver on the path"
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        print(f"browser: {', '.join(packages)} missing for the tests of the labelling page: {how}", file=sys.stderr)
        return 1
    print(f"browser: installing {' '.join(packages)}", flush=True)
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for command in (["update"], ["install", "--yes", "--no-install-recommends", *packages]):
        done = subprocess.run(["apt-get", "-qq", *command], env=environment, stdout=subprocess.DEVNULL)
        if done.returncode != 0:
            print(f"browser: apt-get {command[0]} failed: {how}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
