"""Damaged messages by the ten thousand: the short form of what `scripts/fuzz.py` does by the million."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest
from msg_oracles import packet, words

from msg_adapters import Layout, MessageError, decoder_for

COUNT = 10_000
GROWTH_MAX_MIB = 8.0
"""A leak of a kilobyte a message would be 9 MiB."""

BROKEN_ADAPTER = """
import ctypes, json, fuzz, fuzz_subjects
import numpy as np

class Broken(fuzz_subjects.Subject):
    def take(self, message):
        {fault}

    def check_recovery(self):
        pass

fuzz_subjects.ADAPTERS["broken"] = lambda _: [Broken([fuzz_subjects.Seed(bytes(64), 8)])]
print(json.dumps(fuzz.fuzz_in_child("broken", 100, 0, None)))
"""


def run(repository: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    places = os.pathsep.join(map(str, (repository, repository / "scripts")))
    environment = {**os.environ, "PYTHONPATH": places}
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=600, check=False, env=environment)


@pytest.mark.parametrize("mode", [(), ("--bounds",)], ids=["as in use", "every index checked"])
def test_damaged_messages_are_refused_or_decoded_within_their_bounds(repository, data, mode):
    options = ("--count", str(COUNT), "--recordings", str(data / "drivers"), "--json", *mode)
    done = run(repository, str(repository / "scripts" / "fuzz.py"), *options)
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [row["findings"] for row in rows] == [[]] * 15, done.stderr
    assert done.returncode == 0
    for row in rows:
        assert row["packets"] == COUNT
        assert min(row["accepted"], row["refused"]) > COUNT / 20, row
        assert row["growth_mib"] < GROWTH_MAX_MIB, row


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("raise KeyError('seconds')", "KeyError('seconds')"),
        ("bytearray(1 << 34)", "MemoryError()"),
        ("fuzz_subjects.check_events(fuzz_subjects._events()[:40], fuzz_subjects.Triggers.empty(), 1)", "40 events"),
        ("ctypes.string_at(np.frombuffer(message, 'u1').ctypes.data, len(message) + 1)", "the process ended with -11"),
    ],
    ids=["another exception", "memory out of proportion", "a result that cannot be", "a read beyond the message"],
)
def test_what_must_not_happen_is_found(repository, fault, words):
    done = run(repository, "-c", BROKEN_ADAPTER.format(fault=fault))
    (row,) = map(json.loads, done.stdout.splitlines())
    assert row["findings"], done.stderr
    assert words in row["findings"][0]


@pytest.mark.parametrize(("encoding", "mask_word"), [("evt3", 0x4FFF), ("libcaer_cmp", 0x50FF)])
def test_more_events_than_any_camera_sends_at_once_get_no_memory(encoding, mask_word):
    dense, good = (packet(words("H", said), encoding=encoding) for said in ([mask_word] * (1 << 22), [mask_word]))
    decoder = decoder_for("event_camera_msgs/msg/EventPacket", Layout.ROS2)
    decoder.decode(good)
    tracemalloc.start()
    with pytest.raises(MessageError, match=r"may hold \d+ events, more than 33554432: send them in smaller messages"):
        decoder.decode(dense)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # The arrays for an event a word, that are tried first.
    assert peak < 10 * len(dense)
    assert decoder.decode(good).encoding == encoding


def test_an_index_out_of_bounds_is_found_in_compiled_code(repository, monkeypatch):
    program = """
import fuzz; fuzz._check_bounds()
from msg_adapters.codecs import mono, words
payload = words.as_words(bytes(16), words.WORD_64)
try:
    mono._decode(payload, 0, 9, 9, *words.EventPool().reserve(1))
except IndexError:
    print("found")
"""
    monkeypatch.setenv("NUMBA_BOUNDSCHECK", "1")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(repository / "build" / "fuzz_kernels"))
    assert run(repository, "-c", program).stdout == "found\n"
