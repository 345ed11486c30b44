"""Standard output and error that may be lost, as when a terminal is closed; work must continue without them."""

from __future__ import annotations

import os
import signal
import sys
from typing import TextIO


def open_standard_streams() -> None:
    """Open standard streams that were closed when this process started, on the null device.

    Otherwise, the next file or socket would get their number, and output of libraries would go into it.
    """
    for number, mode in enumerate(("r", "w", "w")):
        try:
            os.fstat(number)
        except OSError:
            opened = os.open(os.devnull, os.O_RDWR)
            if opened != number:  # one with a lower number is closed, too
                os.dup2(opened, number)
                os.close(opened)
            os.set_inheritable(number, True)
        name = ("stdin", "stdout", "stderr")[number]
        if getattr(sys, name) is None:
            stream = open(number, mode, closefd=False)  # noqa: SIM115, stays open
            setattr(sys, name, stream)


def tell(
    text: str, stream: TextIO | None = None, end: str = "\n", *, reader_counts: bool = False
) -> bool:
    """Print at once, if that is possible.

    Args:
        text: What to print.
        stream: Stream to print to; None for standard output.
        end: What to print after the text.
        reader_counts: Whether work is pointless after its reader has exited, as with `| head`.

    Returns:
        Whether the text was printed. If not, nothing will be from now on.

    Raises:
        BrokenPipeError: `reader_counts` is set, the reader has exited, and this process does not ignore SIGHUP. `nohup`
            and `disown` mean that it should outlive its terminal, and with it a reader such as `tee`.
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
    """Write the rest of a stream's buffer, or discard it: at exit, Python would fail on it with status 120."""
    try:
        stream.flush()
    except (OSError, ValueError):
        let_go(stream)


def let_go(stream: TextIO) -> None:
    """Redirect a stream to the null device, so that no printing fails again, including Python's flush at exit."""
    try:
        number = stream.fileno()
    except (OSError, ValueError):  # it has no file
        return
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, number)
    os.close(nothing)
