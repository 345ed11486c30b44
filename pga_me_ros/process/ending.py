"""The end of a process that has loaded large libraries."""

from __future__ import annotations

import atexit
import os
import sys
from typing import NoReturn

from pga_me_ros.process.streams import settle


def leave(status: int) -> NoReturn:
    """End this process with an exit status, once its threads have ended, without dismantling its libraries.

    Python clears every module before it ends. With torch, this takes half a second of computing, for which a run would
    wait when it stops.

    Args:
        status: Exit status; all that must be closed has been closed.

    Raises:
        SystemExit: Always.
    """
    atexit.register(_end, status)  # called after threads have ended, such as those that write files
    raise SystemExit(status)


def _end(status: int) -> None:
    settle(sys.stdout)
    settle(sys.stderr)
    os._exit(status)
