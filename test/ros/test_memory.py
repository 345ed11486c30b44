"""The memory of large messages is returned, whatever else was allocated meanwhile; that of the run's own is kept."""

from __future__ import annotations

import subprocess
import sys

LIMITS = """
import os, resource, sys

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

if "limits" in sys.argv:
    from pga_me_ros.ros.memory import set_malloc_limits
    assert set_malloc_limits()
"""

KEPT = """
for megabytes in (10, 20, 31):  # freeing each one raises the size from which blocks are returned
    bytearray(megabytes * 2**20)
before = resident()
blocks, in_use = [], []
for _ in range(4):
    blocks.append(bytearray(20 * 2**20))
    in_use.append(bytearray(100_000))
del blocks
print(resident() - before)
"""

TOUCHED = """
from pga_me_ros.ros.memory import LARGE, M_MMAP_THRESHOLD
import ctypes

ctypes.CDLL(None).mallopt(M_MMAP_THRESHOLD, LARGE)  # with only that limit, the heap is cut each time
b"x" * (2 * 2**20)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    b"x" * (2 * 2**20)
pages = (resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before) * os.sysconf("SC_PAGE_SIZE")
print(pages / 2**20)
"""


def outcome(program: str, *arguments: str) -> float:
    """Return the number printed by a program in a separate process."""
    command = [sys.executable, "-c", LIMITS + program, *arguments]
    return float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)


def test_large_blocks_are_returned():
    assert outcome(KEPT) > 35.0
    assert outcome(KEPT, "limits") < 5.0


def test_memory_of_smaller_blocks_is_kept_for_the_next_ones():
    assert outcome(TOUCHED) > 20.0
    assert outcome(TOUCHED, "limits") < 5.0
