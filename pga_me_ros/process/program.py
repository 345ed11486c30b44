"""How programs other than nodes end: an exit status and at most one line, never a traceback."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable

from pga_me_ros.errors import PgaError
from pga_me_ros.process.streams import let_go, open_standard_streams, settle, tell


def run_program(work: Callable[[], None], stopped: str = "stopped") -> int:
    """Do the work of a program.

    Args:
        work: Does the work and prints its outcome.
        stopped: What to print after Ctrl-C.

    Returns:
        Exit status: 0; 2 if the work could not be done; 130 after Ctrl-C.
    """
    open_standard_streams()
    try:
        work()
        sys.stdout.flush()
    except KeyboardInterrupt:
        tell(stopped, sys.stderr)
        return 128 + signal.SIGINT
    except BrokenPipeError:  # the reader, such as `head`, has exited
        let_go(sys.stdout)
    except (PgaError, OSError) as error:
        settle(sys.stdout)
        tell(f"error: {error}", sys.stderr)
        return 2
    return 0
