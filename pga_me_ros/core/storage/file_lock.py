"""A lock on a repertoire file: one process at a time may write, and others are told which."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import socket
import time
from pathlib import Path

from pga_me_ros.errors import StorageError

POLL = 0.05
"""Seconds between two attempts to take a lock; flock itself has no timeout."""


class LockedError(StorageError):
    """Another process holds the lock.

    Args:
        message: The message.
        holder: Which process, in words.
    """

    def __init__(self, message: str, holder: str) -> None:
        super().__init__(message)
        self.holder = holder


class FileLock:
    """Exclusive lock that ends with the process that holds it, however that process dies.

    Processes that inherit the file descriptor hold it, too. Releasing the lock does not delete the file, because that
    could take the lock from the next holder.

    Args:
        path: Lock file; made if absent.
        wait: Seconds to wait for a holder that is about to end.
        orphans: Seconds to wait if the process that took the lock is dead, and only its children are left.

    Raises:
        LockedError: Another process (or another part of this one) holds the lock.
        StorageError: The file cannot be made, or its file system does not support locks.
    """

    def __init__(self, path: Path, wait: float = 0.0, orphans: float = 0.0) -> None:
        """Take the lock."""
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise StorageError(
                f"Cannot write '{path}' ({error.strerror}); choose a folder that can be written to."
            ) from None
        try:
            self._take(wait, max(wait, orphans))
        except BlockingIOError:
            holder = self._holder() or "unknown"
            os.close(self._fd)
            raise LockedError(
                f"'{path.name.removesuffix('.lock')}' in '{path.parent}' is being written by "
                f"another process ({holder}). Stop that one first, or choose another folder.",
                holder,
            ) from None
        except OSError as error:  # a file system without locks
            os.close(self._fd)
            raise StorageError(
                f"Cannot lock '{path}' ({error.strerror}); choose a folder on another file system."
            ) from None
        with contextlib.suppress(OSError):  # on a full disk, the holder remains unnamed
            os.ftruncate(self._fd, 0)
            os.pwrite(self._fd, f"pid {os.getpid()} on {socket.gethostname()}\n".encode(), 0)

    def fileno(self) -> int:
        """Return the file descriptor, for children to inherit."""
        return self._fd

    def _take(self, wait: float, orphans: float) -> None:
        start = time.monotonic()
        while True:
            try:
                return fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                waited = time.monotonic() - start
                if waited > orphans or (waited > wait and not self._orphaned()):
                    raise
                time.sleep(POLL)

    def _holder(self) -> str:
        return os.pread(self._fd, 200, 0).decode(errors="replace").strip()

    def _orphaned(self) -> bool:
        """Whether the process that took the lock ran on this machine and is dead."""
        match = re.fullmatch(r"pid (\d{1,9}) on (.+)", self._holder())
        if not match or match[2] != socket.gethostname():
            return False
        try:
            os.kill(int(match[1]), 0)
        except ProcessLookupError:
            return True
        except PermissionError:
            return False
        return False

    def release(self) -> None:
        """Release the lock; a second call does nothing."""
        if self._fd >= 0:
            os.ftruncate(self._fd, 0)
            os.close(self._fd)
            self._fd = -1
