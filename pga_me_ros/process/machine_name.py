"""A name that one process of this machine at a time can hold."""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import struct
import time
from types import TracebackType

BACKLOG = 4096
"""Askers that wait in the kernel's queue until the holder ends; those beyond it are not told who the holder is."""

SOON = 30.0
"""Seconds within which a process that has bound a socket also listens on it, even if others come between."""

POLL = 0.01
"""Seconds between two looks at a socket that nobody listens on yet."""

CREDENTIALS = struct.Struct("3i")
"""Process, user and group at the other end of a socket."""


class HeldNameError(Exception):
    """Another process holds the name.

    Args:
        pid: The process; 0 if it cannot be told, as across containers.
    """

    def __init__(self, pid: int) -> None:
        super().__init__(pid)
        self.pid = pid


class MachineName:
    """A name that this process holds until it releases it or ends, however it ends.

    It is the address of a socket in Linux's abstract namespace: the kernel gives it to one process, without any wait,
    and takes it back at the end of that process. No file is left over, and child processes do not hold it. Names reach
    as far as the network's loopback: containers share them if they share their network. Users have names of their own.

    Where a sandbox denies such sockets, nothing is held.

    Args:
        parts: The name, in parts of any length.

    Raises:
        HeldNameError: Another process, or another part of this one, holds it.
    """

    def __init__(self, *parts: str) -> None:
        """Take the name."""
        key = "\0".join([str(os.geteuid()), *parts])  # the kernel takes 107 bytes
        self._address = f"\0pga_me_ros/{hashlib.sha256(key.encode()).hexdigest()}"
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._take()
        except BaseException:
            self.release()
            raise

    def __enter__(self) -> MachineName:
        """Hold it for a block."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Release it."""
        self.release()

    def release(self) -> None:
        """Release the name; a second call does nothing."""
        self._socket.close()

    def _take(self) -> None:
        deadline = time.monotonic() + SOON
        while True:
            try:
                self._socket.bind(self._address)
                return self._socket.listen(BACKLOG)
            except PermissionError:
                return None
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
            try:
                pid = self._holder()
            except ConnectionRefusedError:  # it does not listen yet, or has just ended
                pid = 0
                if time.monotonic() < deadline:
                    time.sleep(POLL)
                    continue
            raise HeldNameError(pid)

    def _holder(self) -> int:
        """Return the process that listens on the address, 0 if it cannot be told.

        Raises:
            ConnectionRefusedError: None does.
        """
        with socket.socket(socket.AF_UNIX) as asker:
            asker.setblocking(False)
            try:
                asker.connect(self._address)
            except BlockingIOError:  # too many have asked before
                return 0
            said = asker.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, CREDENTIALS.size)
        pid, _, _ = CREDENTIALS.unpack(said)
        return int(pid)
