"""How the programs that are no nodes end: an exit status and at most one line, never a traceback."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable

from pga_me_ros.core.errors import PgaError


def run_program(work: Callable[[], None], stopped: str = "stopped") -> int:
    """Do the work of a program.

    Args:
        work: Does it, and prints what came of it.
        stopped: What to say after Ctrl-C.

    Returns:
        Exit status: 0; 2 when it could not be done; 130 after Ctrl-C.
    """
    try:
        work()
    except KeyboardInterrupt:
        print(stopped, file=sys.stderr)
        return 128 + signal.SIGINT
    except BrokenPipeError:  # the reader, such as `head`, has seen enough
        sys.stderr.close()
    except (PgaError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0
