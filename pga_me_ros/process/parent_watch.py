"""A child of the graph ends when its parent is gone, however the parent died.

One that was started early (`process.prepared_child`) also waits for its parent's word before it does anything but
import its libraries.
"""

from __future__ import annotations

import os
import socket
import sys
import threading

PARENT_WATCH = "PGA_ME_PARENT_WATCH"
"""Environment variable that tells a child to end when its standard input closes, that is, when its parent is gone."""

WAIT_FOR_WORD = "PGA_ME_WAIT_FOR_WORD"
"""Environment variable that tells a child to wait for its parent's word; its standard input is then a socket, on which
the word comes with the file descriptors of the child's log and of what the child keeps open."""

MOST_DESCRIPTORS = 8
"""Maximum number of file descriptors that come with the word."""

MOST_EARLY_OUTPUT = 1_000_000
"""Maximum bytes of output before the word, and again while it is heard, that are moved to the log."""

SETTLE = 0.02
"""Seconds until what another thread was printing while the word came has arrived where output went before."""

GRACE = 2.0
"""Seconds that a child gets to end by itself after its parent is gone."""

EXIT_ORPHANED = 1


_told = threading.Event()


def wait_for_word() -> None:
    """Wait until the parent says that the work begins, if it started this process early."""
    if os.environ.get(PARENT_WATCH) == "1" and os.environ.get(WAIT_FOR_WORD) == "1":
        _told.wait()


def watch_parent() -> None:
    """End this process soon after its parent is gone, if it was started as a child of the graph.

    The parent holds the other end of standard input, which the kernel closes however the parent dies. Call this before
    importing libraries that take seconds, or the process outlives its parent by as much.
    """
    if os.environ.get(PARENT_WATCH) == "1":
        threading.Thread(target=_end_with_input, name="parent watch", daemon=True).start()


def _end_with_input() -> None:
    if os.environ.get(WAIT_FOR_WORD) == "1":
        _hear_word()
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


def _hear_word() -> None:
    """Wait for the parent's word, move output to the log that comes with it, and keep the other files open.

    If the parent dies first, nothing comes, and standard input has ended.
    """
    with socket.socket(fileno=os.dup(0)) as stdin:
        word, descriptors, _, _ = socket.recv_fds(stdin, 1, MOST_DESCRIPTORS)
    if word:
        log, early = descriptors[0], os.dup(1)
        moved = os.write(log, os.pread(early, MOST_EARLY_OUTPUT, 0))
        os.dup2(log, 1)
        os.dup2(log, 2)
        threading.Event().wait(SETTLE)  # a thread may have been in the middle of printing
        os.write(log, os.pread(early, MOST_EARLY_OUTPUT, moved))
        os.close(early)
        os.close(log)
        _told.set()
