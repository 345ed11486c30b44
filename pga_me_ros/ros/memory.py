"""Which memory a process gives back to the system when it is done with a message, and which it keeps for the next."""

from __future__ import annotations

import ctypes

M_TRIM_THRESHOLD = -1
M_MMAP_THRESHOLD = -3
"""glibc's numbers of the parameters, see mallopt(3)."""

LARGE = 8 * 2**20
"""Bytes from which on a block is given back as soon as it is freed; the run's own messages are smaller."""

KEPT = 64 * 2**20
"""Free bytes at the end of the heap that are kept: the blocks of the next generation's messages."""


def set_malloc_limits() -> bool:
    """Have the C library give large blocks back when they are freed, and keep what smaller ones leave.

    glibc by itself raises the limit with each large block that is freed, to 32 MiB: the blocks of later messages then
    come from the heap, where small ones that are still in use keep them from being given back. A stray node that
    sends some messages of tens of megabytes would make a process larger for good.

    The other limit it raises together with the first. By itself it is 128 kB, so that the heap would be cut after each
    message of the run, and the next one would have to touch new pages: tens of thousands in a generation.

    Returns:
        Whether it can be done here; other C libraries have no such limits.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGE) and mallopt(M_TRIM_THRESHOLD, KEPT))
