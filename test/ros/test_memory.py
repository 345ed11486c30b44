"""The memory of large messages is given back, whatever else was allocated meanwhile."""

from __future__ import annotations

import subprocess
import sys

KEPT = """
import os, sys

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20

if "give back" in sys.argv:
    from pga_me_ros.ros.memory import give_back_large_blocks
    assert give_back_large_blocks()
for megabytes in (10, 20, 31):  # each one freed raises the limit from which on blocks are given back
    bytearray(megabytes * 2**20)
before = resident()
blocks, in_use = [], []
for _ in range(4):
    blocks.append(bytearray(20 * 2**20))
    in_use.append(bytearray(100_000))
del blocks
print(resident() - before)
"""


def kept(*arguments: str) -> float:
    """Return the MiB that a process keeps of four freed blocks of 20 MiB with small ones between them."""
    command = [sys.executable, "-c", KEPT, *arguments]
    return float(subprocess.run(command, capture_output=True, check=True, text=True).stdout)


def test_large_blocks_are_given_back():
    assert kept() > 35.0
    assert kept("give back") < 5.0
