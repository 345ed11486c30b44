"""Which memory a process returns to the system after a message, and which it keeps for the next."""

from __future__ import annotations

import ctypes

M_TRIM_THRESHOLD = -1
M_MMAP_THRESHOLD = -3
"""glibc's numbers for the parameters, see mallopt(3)."""

LARGE = 8 * 2**20
"""Size in bytes from which a block is returned as soon as it is freed; the run's own messages are smaller."""

KEPT = 64 * 2**20
"""Free bytes to keep at the end of the heap, for the next generation's messages."""


def set_malloc_limits() -> bool:
    """Make the C library return large blocks when they are freed, and keep the memory of smaller ones.

    By default, glibc raises the first limit with each large block that is freed, up to 32 MiB. The blocks of later
    messages then come from the heap, where small blocks in use keep them from being returned. A stray node that sends
    a few messages of tens of megabytes would make a process larger for good.

    By default, glibc raises the second limit along with the first. Set by itself, the first would leave the second at
    128 kB: the heap would be cut after each message of the run, and the next one would have to touch new pages, tens
    of thousands in a generation.

    Returns:
        Whether this is possible here; other C libraries have no such limits.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGE) and mallopt(M_TRIM_THRESHOLD, KEPT))
