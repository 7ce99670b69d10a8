"""Gives every message adapter damaged messages, and looks for what must never happen.

That is: a crash, a read beyond the message, an exception other than the announced one, a result that cannot be, memory
that grows or is out of proportion to the message, a good message that is decoded otherwise after garbage.

`python scripts/fuzz.py --count 1000000` for all adapters, or name some. With `--bounds` the kernels check each index,
and each array that they fill is exactly as long as they ask for. Each message ends where forbidden memory begins, or
begins where such memory ends. The same seed gives the same messages. Exit code 1 if anything was found.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import mmap
import multiprocessing
import os
import random
import resource
import struct
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

PAGE = mmap.PAGESIZE
KERNELS = Path(__file__).resolve().parents[1] / "build" / "fuzz_kernels"
MEMORY_BYTES = 1 << 18
ADDRESS_SPACE_MORE = 1 << 30
"""What a subject may ask for beyond what it has at the start; `stream` keeps state for the pixels of any sensor."""
STREAM_MORE = 1 << 33
RECOVERY_PERIOD = 64
SETTLING_ROUNDS = 80
"""Pools of arrays let go of what was not used for 64 messages."""
FINDINGS_MAX = 5
BOUNDARIES = (0, 1, 2, 3, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x10000, 2**31 - 1, 2**31, 2**32 - 2, 2**32 - 1)
HEAD_BYTES = 120
LONG_SHARE = 1 / 4096

Mutation = Callable[[random.Random, bytearray, Sequence[Any], int], None]


class GuardedMemory:
    """Memory between two pages that may not be touched: a read beyond a message placed here ends the process.

    It is shared with child processes, so that a parent can tell what killed its child.
    """

    def __init__(self) -> None:
        self._map = mmap.mmap(-1, MEMORY_BYTES + 2 * PAGE)
        self._view = memoryview(self._map)
        self._placed = mmap.mmap(-1, PAGE)
        address = ctypes.addressof(ctypes.c_char.from_buffer(self._map))
        libc = ctypes.CDLL(None, use_errno=True)
        for page in (address, address + PAGE + MEMORY_BYTES):
            if libc.mprotect(ctypes.c_void_p(page), ctypes.c_size_t(PAGE), 0):
                raise OSError(ctypes.get_errno(), "mprotect")

    def place(self, message: bytes | bytearray, *, at_end: bool) -> memoryview:
        """The message, copied to one end of the memory."""
        size = len(message)
        start = PAGE + (MEMORY_BYTES - size if at_end else 0)
        self._view[start : start + size] = message
        struct.pack_into("<QQ", self._placed, 0, start, size)
        return self._view[start : start + size]

    def placed(self) -> bytes:
        """The message placed last."""
        start, size = struct.unpack_from("<QQ", self._placed)
        return bytes(self._view[start : start + size])


def flip_bits(rng: random.Random, data: bytearray, _seeds: Sequence[Any], _body: int) -> None:
    """A few bits wrong."""
    for _ in range(rng.randrange(1, 6)):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def truncate(rng: random.Random, data: bytearray, _seeds: Sequence[Any], _body: int) -> None:
    """The end is missing."""
    del data[rng.randrange(len(data)) :]


def extend(rng: random.Random, data: bytearray, _seeds: Sequence[Any], _body: int) -> None:
    """Something follows, now and then a lot."""
    data += rng.randbytes(MEMORY_BYTES // 4 if rng.random() < LONG_SHARE else rng.randrange(64))


def splice(rng: random.Random, data: bytearray, seeds: Sequence[Any], _body: int) -> None:
    """The beginning of one message and the end of another."""
    other = rng.choice(seeds).message
    data[rng.randrange(len(data)) :] = other[rng.randrange(len(other)) :]


def set_field(rng: random.Random, data: bytearray, _seeds: Sequence[Any], _body: int) -> None:
    """A boundary value where a length, count or size may stand."""
    code = rng.choice("HIQ")
    size = struct.calcsize(code)
    if len(data) >= size:
        place = rng.randrange(min(len(data), HEAD_BYTES) - size + 1)
        value = rng.choice(BOUNDARIES) if code != "Q" else rng.choice(BOUNDARIES) << rng.choice((0, 32))
        struct.pack_into("<" + code, data, place, value & (1 << 8 * size) - 1)


def replace_payload(rng: random.Random, data: bytearray, _seeds: Sequence[Any], body: int) -> None:
    """Random words behind a good head."""
    data[body:] = rng.randbytes(max(len(data) - body, 0))


def reorder(rng: random.Random, data: bytearray, _seeds: Sequence[Any], _body: int) -> None:
    """A part elsewhere, or twice."""
    start = rng.randrange(len(data))
    part = data[start : start + rng.randrange(1, 64)]
    if rng.random() < 0.5:
        del data[start : start + len(part)]
    place = rng.randrange(len(data) + 1)
    data[place:place] = part


MUTATIONS: tuple[Mutation, ...] = (flip_bits, truncate, extend, splice, set_field, set_field, replace_payload, reorder)


def mutated(rng: random.Random, seeds: Sequence[Any]) -> bytearray:
    """A good message with one to four things done to it."""
    seed = seeds[int(rng.random() * len(seeds))]
    data = bytearray(seed.message)
    for _ in range(rng.choice((1, 1, 2, 4))):
        if data:
            MUTATIONS[int(rng.random() * len(MUTATIONS))](rng, data, seeds, seed.body)
    return data[:MEMORY_BYTES]


def fuzz(name: str, count: int, seed: int, recordings: Path | None, memory: GuardedMemory) -> dict[str, Any]:
    """Give `count` messages to an adapter; what it took and what was found."""
    from fuzz_subjects import ADAPTERS

    from etd_ros.errors import EtdError

    rng = random.Random(f"{name}/{seed}")
    subjects = ADAPTERS[name](recordings)
    warm_mib, started_s = settled_mib(subjects), time.monotonic()
    _limit_memory(STREAM_MORE if name == "stream" else ADDRESS_SPACE_MORE)
    number = accepted = refused = 0
    findings: list[str] = []
    for number in range(count):
        subject = subjects[number % len(subjects)]
        data = mutated(rng, subject.seeds)
        message = memory.place(data, at_end=number // len(subjects) % 4 > 0).toreadonly()
        try:
            subject.take(message)
            accepted += 1
        except EtdError:
            refused += 1
        # Whatever else a decoder raises is what is looked for.
        except Exception as err:
            findings.append(f"message {number}: {err!r}: {bytes(data[:2000]).hex()}")
        if number % RECOVERY_PERIOD == 0:
            try:
                subject.check_recovery()
            except Exception as err:
                findings.append(f"after message {number}: {err!r}")
        if number == count // 10:
            warm_mib = settled_mib(subjects)
        if len(findings) >= FINDINGS_MAX:
            break
    return {
        "adapter": name,
        "packets": number + 1,
        "accepted": accepted,
        "refused": refused,
        "seconds": round(time.monotonic() - started_s, 2),
        "growth_mib": round(settled_mib(subjects) - warm_mib, 2),
        "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "findings": findings,
    }


def fuzz_in_child(name: str, count: int, seed: int, recordings: Path | None) -> dict[str, Any]:
    """The same in a process of its own, whose death is a finding."""
    memory = GuardedMemory()
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=lambda: sender.send(fuzz(name, count, seed, recordings, memory)))
    child.start()
    sender.close()
    try:
        found: dict[str, Any] = receiver.recv()
    except EOFError:
        child.join()
        found = {"adapter": name, "packets": 0, "accepted": 0, "refused": 0, "seconds": 0.0}
        killed = f"the process ended with {child.exitcode}: {memory.placed()[:2000].hex()}"
        found |= {"growth_mib": 0.0, "peak_mib": 0, "findings": [killed]}
    child.join()
    return found


def settled_mib(subjects: Sequence[Any]) -> float:
    """Resident memory of this process (MiB) after good messages: what was claimed before them is let go by then."""
    for _ in range(SETTLING_ROUNDS):
        for subject in subjects:
            subject.check_recovery()
    ctypes.CDLL(None).malloc_trim(ctypes.c_size_t(0))
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE / 2**20


def _limit_memory(more: int) -> None:
    """Have an allocation out of proportion fail."""
    limit = int(Path("/proc/self/statm").read_text().split()[0]) * PAGE + more
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def _reserve_exactly(pool: Any, length: int) -> tuple[Any, ...]:
    import numpy as np

    return tuple(np.empty(length, dtype) for dtype in pool._dtypes)


def _check_bounds() -> None:
    """Have kernels check every index, and give them arrays no longer than they ask for.

    The compiler reads its settings when it is imported, so the program starts once more.
    """
    if os.environ.get("NUMBA_BOUNDSCHECK") != "1":
        # The cache does not tell kernels that check from those that do not.
        environment = {**os.environ, "NUMBA_BOUNDSCHECK": "1", "NUMBA_CACHE_DIR": str(KERNELS)}
        os.execve(sys.executable, [sys.executable, *sys.argv], environment)
    from etd_ros.buffers import ArrayPool

    ArrayPool.reserve = _reserve_exactly  # type: ignore[method-assign]


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("adapters", nargs="*", metavar="ADAPTER", help="default: all")
    parser.add_argument("--count", type=int, default=10_000, help="of messages to each adapter (default: 10000)")
    parser.add_argument("--seed", type=int, default=0, help="of the random numbers (default: 0)")
    parser.add_argument("--bounds", action="store_true", help="check every index of the kernels")
    parser.add_argument("--recordings", type=Path, metavar="FOLDER", help="of recordings whose messages are used, too")
    parser.add_argument("--json", action="store_true", help="print one JSON object a line instead of a table")
    return parser.parse_args(arguments)


def main() -> int:
    """Run and print a row for each adapter."""
    options = _parse(None)
    if options.bounds:
        _check_bounds()
    from fuzz_subjects import ADAPTERS

    unknown = sorted(set(options.adapters) - set(ADAPTERS))
    if unknown:
        print(f"fuzz: {unknown[0]} is no adapter: choose from {', '.join(ADAPTERS)}", file=sys.stderr)
        return 2
    bad = 0
    for name in options.adapters or ADAPTERS:
        row = fuzz_in_child(name, options.count, options.seed, options.recordings)
        bad += bool(row["findings"])
        if options.json:
            print(json.dumps(row), flush=True)
            continue
        print(
            f"{name:15} {row['packets']:9,} packets {row['accepted']:9,} accepted {row['refused']:9,} refused "
            f"{row['seconds']:8.1f} s {row['growth_mib']:+7.2f} MiB {row['peak_mib']:6} MiB peak",
            flush=True,
        )
        for finding in row["findings"]:
            print(f"  {finding}", flush=True)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
