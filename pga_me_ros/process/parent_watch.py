"""A child of the graph ends when its parent is gone, however the parent died."""

from __future__ import annotations

import os
import sys
import threading

PARENT_WATCH = "PGA_ME_PARENT_WATCH"
"""Environment variable that tells a child to end when its standard input closes, that is, when its parent is gone."""

GRACE = 2.0
"""Seconds that a child gets to end by itself after its parent is gone."""

EXIT_ORPHANED = 1


def watch_parent() -> None:
    """End this process soon after its parent is gone, if it was started as a child of the graph.

    The parent holds the other end of standard input, which the kernel closes however the parent dies. Call this before
    importing libraries that take seconds, or the process outlives its parent by as much.
    """
    if os.environ.get(PARENT_WATCH) == "1":
        threading.Thread(target=_end_with_input, name="parent watch", daemon=True).start()


def _end_with_input() -> None:
    while os.read(0, 4096):
        pass
    try:
        # Importing it here could wait forever for an import that has just begun in another thread.
        shutdown = getattr(sys.modules.get("rclpy"), "try_shutdown", None)
        if shutdown is not None:  # otherwise there is no node yet that could end cleanly
            shutdown()
            threading.Event().wait(GRACE)
    finally:
        os._exit(EXIT_ORPHANED)
