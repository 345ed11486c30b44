"""A limit on how long ROS 2 may take to dismantle a node, which holds where no Python thread could end the process.

Fast DDS waits without a limit for a callback of its discovery, and may wait for it forever: it spins on the mutex that
the callback needs (eProsima/Fast-DDS, issue 6513). rclpy destroys a node with Python's lock held, so neither a signal's
handler nor another thread is ever called.
"""

from __future__ import annotations

import faulthandler
from collections.abc import Iterator
from contextlib import contextmanager

LIMIT = 10.0
"""Seconds that ROS 2 may take to destroy a node, which is a matter of milliseconds."""

_STDERR = 2

_for_good = False


@contextmanager
def dismantling() -> Iterator[None]:
    """End this process with exit status 1 and the stacks of its threads if the block takes longer than `LIMIT`."""
    if not _for_good:
        faulthandler.dump_traceback_later(LIMIT, exit=True, file=_STDERR)
    try:
        yield
    finally:
        if not _for_good:
            faulthandler.cancel_dump_traceback_later()


def end_within(seconds: float) -> None:
    """End this process with exit status 1 after so many seconds if it has not ended by then, whatever it does.

    Args:
        seconds: Seconds from now.
    """
    global _for_good
    _for_good = True
    faulthandler.dump_traceback_later(seconds, exit=True, file=_STDERR)
