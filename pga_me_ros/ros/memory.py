"""Giving the memory of large messages back to the system."""

from __future__ import annotations

import ctypes

M_MMAP_THRESHOLD = -3
"""glibc's number of the parameter, see mallopt(3)."""

LARGE = 8 * 2**20
"""Bytes from which on a block is given back as soon as it is freed; the run's own messages are smaller."""


def give_back_large_blocks() -> bool:
    """Have the C library give large blocks back when they are freed.

    glibc by itself raises the limit with each large block that is freed, to 32 MiB: the blocks of later messages then
    come from the heap, where small ones that are still in use keep them from being given back. A stray node that
    sends some messages of tens of megabytes would make a process larger for good.

    Returns:
        Whether it can be done here; other C libraries have no such limit.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGE))
