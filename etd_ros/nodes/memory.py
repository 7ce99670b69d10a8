"""Memory that is there when the first busy moment needs it."""

from __future__ import annotations

import ctypes

MIB = 2**20
HELD_MIB = 12
"""What waits in the queue where a fast camera's events begin to come. It is memory of the main thread, which takes the
messages: the C library has others for other threads, which the first busy moment touches."""

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD = -1, -3
LARGE_BYTES = 32 * MIB
"""Blocks up to this size come from memory that was let go of before; the C library takes no more."""
KEPT_BYTES = 2**30


def hold_memory() -> None:
    """Have the C library keep what is let go of, and touch `HELD_MIB` of it now.

    A fast camera's messages take a megabyte each. Blocks of that size would go back to the system each time, and come
    anew; the first touch of each of their pages takes up to 10 us, where the machine is a virtual one. In the first
    moments of a busy scene that adds up to 0.1 s, in which a target goes far. Without a C library of GNU's nothing is
    done.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError, TypeError):
        return
    mallopt(M_MMAP_THRESHOLD, LARGE_BYTES)
    mallopt(M_TRIM_THRESHOLD, KEPT_BYTES)
    touched = [b"\1" * MIB for _ in range(HELD_MIB)]
    del touched
