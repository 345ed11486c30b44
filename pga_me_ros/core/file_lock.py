"""Who may write a repertoire file: one process at a time, named to the ones that come too late."""

from __future__ import annotations

import fcntl
import os
import socket
from pathlib import Path

from pga_me_ros.core.errors import StorageError


class FileLock:
    """Exclusive lock that ends with the process that holds it, however that dies.

    The file stays behind when the lock is released: deleting it could take it from the next holder.

    Args:
        path: Lock file; made if absent.

    Raises:
        StorageError: Another process (or another part of this one) holds the lock, or the file
            cannot be made.
    """

    def __init__(self, path: Path) -> None:
        """Take the lock."""
        try:
            self._fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise StorageError(
                f"Cannot write '{path}' ({error.strerror}); choose a run_dir that is writable."
            ) from None
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            holder = os.pread(self._fd, 200, 0).decode(errors="replace").strip() or "unknown"
            os.close(self._fd)
            raise StorageError(
                f"'{path.name.removesuffix('.lock')}' in '{path.parent}' is being written by "
                f"another process ({holder}; {error.strerror}). Stop that one first, or choose "
                "another run_dir."
            ) from None
        os.ftruncate(self._fd, 0)
        os.pwrite(self._fd, f"pid {os.getpid()} on {socket.gethostname()}\n".encode(), 0)

    def release(self) -> None:
        """Give the lock up; once is enough."""
        if self._fd >= 0:
            os.ftruncate(self._fd, 0)
            os.close(self._fd)
            self._fd = -1
