"""How many cores of this machine have nothing to do, for work that can do with more or fewer threads.

Where more threads than cores take turns, each loses what it had in the core's cache, and threads that wait for each
other wait for their turn as well. So whoever can do without a thread asks here first. No result depends on the answer.
"""

from __future__ import annotations

import os
from functools import cache

LOAD = "/proc/loadavg"
"""Where Linux tells how many threads run or could run, whoever owns them."""


def spare_cores() -> int:
    """Return the number of cores that nobody uses right now.

    The caller's core is in use. A negative number says how many threads wait for their turn. Where the system does not
    tell, the caller is taken to be alone.
    """
    cores = os.cpu_count() or 1
    load = _load()
    if load is None:
        return cores - 1
    # As in "0.92 2.17 2.31 3/179 17945": three are running or could run, the reader among them.
    running = os.pread(load, 100, 0).split()[3].split(b"/")[0]
    return cores - int(running)


@cache
def _load() -> int | None:
    """Return a file descriptor that is kept open: a reading then takes 2 µs."""
    try:
        return os.open(LOAD, os.O_RDONLY)
    except OSError:
        return None
