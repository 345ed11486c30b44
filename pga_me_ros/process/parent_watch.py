"""A child of the graph ends when its parent is gone, however the parent died.

One that was started early (`process.prepared_child`) also waits for its parent's word before it does anything but
import its libraries.
"""

from __future__ import annotations

import atexit
import os
import socket
import sys
import threading

from pga_me_ros.process.dismantling import end_within

PARENT_WATCH = "PGA_ME_PARENT_WATCH"
"""Environment variable that tells a child to end when its standard input closes, that is, when its parent is gone."""

WAIT_FOR_WORD = "PGA_ME_WAIT_FOR_WORD"
"""Environment variable that tells a child to wait for its parent's word; its standard input is then a socket, on which
the word comes with the file descriptors of the child's log and of what the child keeps open."""

MOST_DESCRIPTORS = 8
"""Maximum number of file descriptors that come with the word."""

MOST_EARLY_OUTPUT = 1_000_000
"""Maximum bytes of output before the word that are moved to the log."""

GRACE = 2.0
"""Seconds that a child gets to end by itself after its parent is gone."""

EXIT_ORPHANED = 1


_told = threading.Event()
_logs: list[int] = []
"""File descriptor of the log that came with the word, until output goes there."""


def wait_for_word() -> None:
    """Wait for the parent to say that the work begins, if it started this process early; then print to its log."""
    if os.environ.get(PARENT_WATCH) == "1" and os.environ.get(WAIT_FOR_WORD) == "1":
        _told.wait()
        _move_output()


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
    end_within(2 * GRACE)
    _move_output()
    try:
        # Importing it here could wait forever for an import that has just begun in another thread.
        shutdown = getattr(sys.modules.get("rclpy"), "try_shutdown", None)
        if shutdown is not None:  # otherwise there is no node yet that could end cleanly
            shutdown()
            threading.Event().wait(GRACE)
    finally:
        os._exit(EXIT_ORPHANED)


def _hear_word() -> None:
    """Wait for the parent's word, and keep the files open that come with it.

    If the parent dies first, nothing comes, and standard input has ended.
    """
    with socket.socket(fileno=os.dup(0)) as stdin:
        word, descriptors, _, _ = socket.recv_fds(stdin, 1, MOST_DESCRIPTORS)
    if word:
        _logs.append(descriptors[0])
        atexit.register(_move_output)  # of a process that ends before it waits for the word
        _told.set()


def _move_output() -> None:
    """Move output to the log that came with the word.

    The thread that prints does it, once it has nothing to do but wait: another one might come between the parts of a
    line.
    """
    if _logs:
        log = _logs.pop()
        os.write(log, os.pread(1, MOST_EARLY_OUTPUT, 0))
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.close(log)
