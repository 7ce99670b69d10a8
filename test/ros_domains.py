"""ROS domains for tests that run real processes, and what those processes leave in shared memory."""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterator
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
DOMAIN_IDS = range(1, 96)
"""The packaging tests have the next two."""
FIRST_PORT, DOMAIN_PORTS = 7400, 250
"""DDS gives each domain its range of ports."""


def domain_of(name: str) -> int | None:
    """The domain whose port a file in shared memory serves, and None for any other file.

    A few ports are shared by all domains; they count as those of domains that no test uses.
    """
    port = re.search(r"fastrtps_port(\d+)", name)
    return (int(port[1]) - FIRST_PORT) // DOMAIN_PORTS if port else None


def fresh_domains() -> Iterator[int]:
    """Domains that nobody seems to use: a process that was killed leaves port files, and they outlive a later user.

    Where every domain has such files, they are no reason to pass one over.
    """
    start = os.getpid() % len(DOMAIN_IDS)
    for domains in itertools.repeat([*DOMAIN_IDS[start:], *DOMAIN_IDS[:start]]):
        used = {domain_of(path.name) for path in SHARED_MEMORY.glob("fastrtps_port*")}
        yield from [domain for domain in domains if domain not in used] or domains


def clear(domain: int) -> None:
    """Remove the port files of a domain whose processes have all ended, some of them killed."""
    for path in SHARED_MEMORY.iterdir():
        if domain_of(path.name) == domain:
            path.unlink(missing_ok=True)
