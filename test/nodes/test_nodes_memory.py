"""What a node's first busy moment needs is there."""

import subprocess
import sys

from etd_ros.nodes.memory import HELD_MIB

FAULTS = """
import resource
from etd_ros.nodes.memory import HELD_MIB, MIB, hold_memory

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    blocks = [bytes([1]) * MIB for _ in range(HELD_MIB // 2)]
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

without = faults()
hold_memory()
print(without, faults(), faults())
"""


def test_memory_that_is_held_is_neither_touched_for_the_first_time_nor_given_back():
    ran = subprocess.run([sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True)
    without, first, again = (int(word) for word in ran.stdout.split())
    pages = HELD_MIB // 2 * 256
    assert without > 0.9 * pages
    assert first < 0.1 * pages
    assert again < 0.1 * pages
