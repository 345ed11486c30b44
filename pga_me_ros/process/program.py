"""How programs other than nodes end: an exit status and at most one line, never a traceback."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from pga_me_ros.dependencies import EXIT_BAD_INPUT, missing_dependency
from pga_me_ros.errors import PgaError
from pga_me_ros.process.early_signals import hand_over
from pga_me_ros.process.streams import let_go, open_standard_streams, settle, tell


def run_program(work: Callable[[], None], stopped: str = "stopped") -> int:
    """Do the work of a program.

    Args:
        work: Does the work and prints its outcome.
        stopped: What to print after Ctrl-C or SIGTERM.

    Returns:
        Exit status: 0; 2 if the work could not be done; 128 + the signal's number if Ctrl-C or SIGTERM stopped it, so
        that a shell does not take it for done.
    """
    open_standard_streams()
    hand_over()
    try:
        with _ended_by_sigterm():
            work()
        sys.stdout.flush()
    except KeyboardInterrupt as signalled:
        tell(stopped, sys.stderr)
        return 128 + (signalled.args[0] if signalled.args else signal.SIGINT)
    except BrokenPipeError:  # the reader, such as `head`, has exited
        let_go(sys.stdout)
    except (PgaError, OSError, ModuleNotFoundError) as error:
        if isinstance(error, ModuleNotFoundError) and not missing_dependency(error):
            raise
        settle(sys.stdout)
        tell(f"error: {missing_dependency(error) or _said(error)}", sys.stderr)
        return EXIT_BAD_INPUT
    return 0


def _said(error: Exception) -> str:
    """Return an error in words; those of the system name a file and a reason, and no more."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"'{error.filename}': {error.strerror}; check the path, its permissions and the space on its disk."
    return str(error)


@contextmanager
def _ended_by_sigterm() -> Iterator[None]:
    """Let SIGTERM end a block like Ctrl-C; a second one ends the process at once."""

    def interrupt(number: int, _: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)
        raise KeyboardInterrupt(number)

    if threading.current_thread() is not threading.main_thread() or (
        signal.getsignal(signal.SIGTERM) != signal.SIG_DFL
    ):
        yield
        return
    signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
