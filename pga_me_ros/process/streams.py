"""Standard output and error that may go away, as when a terminal is closed: work must not end with them."""

from __future__ import annotations

import os
import signal
import sys
from typing import TextIO


def open_standard_streams() -> None:
    """Open those of the three standard streams that were closed by whoever started this process, on nothing.

    Otherwise the next file or socket gets their number, and what a library prints lands in it.
    """
    for number, mode in enumerate(("r", "w", "w")):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:  # one with a lower number is closed as well
                os.dup2(opened, number)
                os.close(opened)
            os.set_inheritable(number, True)
        name = ("stdin", "stdout", "stderr")[number]
        if getattr(sys, name) is None:
            stream = open(number, mode, closefd=False)  # noqa: SIM115, it stays open
            setattr(sys, name, stream)


def tell(
    text: str, stream: TextIO | None = None, end: str = "\n", *, reader_counts: bool = False
) -> bool:
    """Print at once, as far as that is possible.

    Args:
        text: What to print.
        stream: Where; None takes standard output.
        end: What comes behind it.
        reader_counts: Whether work has no purpose once its reader has left, as with `| head`.

    Returns:
        Whether it was printed. If not, nothing will be from now on.

    Raises:
        BrokenPipeError: The reader has left and counts, and this process does not ignore SIGHUP: `nohup` and `disown`
            say that it is to outlive its terminal, and with it a reader such as `tee`.
    """
    stream = stream or sys.stdout
    try:
        print(text, end=end, file=stream, flush=True)
    except (OSError, ValueError) as error:  # full or gone; ValueError: closed in this process
        outlives = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
        if reader_counts and isinstance(error, BrokenPipeError) and not outlives:
            raise
        let_go(stream)
        return False
    return True


def settle(stream: TextIO) -> None:
    """Write what is left in a stream's buffer, or forget it: Python would fail on that at its end, with status 120."""
    try:
        stream.flush()
    except (OSError, ValueError):
        let_go(stream)


def let_go(stream: TextIO) -> None:
    """Point a stream at nothing, so that nothing that prints fails again, Python's flush at its end included."""
    try:
        number = stream.fileno()
    except (OSError, ValueError):  # it has no file
        return
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, number)
    os.close(nothing)
