"""Ctrl-C, SIGTERM and the like for a program that stops cleanly on the first signal and at once on the second."""

from __future__ import annotations

import os
import select
import signal
from collections.abc import Callable
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM)
"""Signals that tell a program to end."""

LOSING = (signal.SIGHUP, signal.SIGQUIT)
"""Signals by which it loses its terminal, or is to end at once; unless caught or ignored, nothing is closed."""


class SecondSignal(BaseException):
    """The user does not want to wait any longer."""


class Signals:
    """Catches the signals that tell this program to end; to be made in the main thread.

    Args:
        first: Called with the number of the first signal, in its handler.
        later: Called in the same way for each further one; it may raise, like `insist`.
        losing: Whether `LOSING` are caught, too, where they are not ignored (as by `nohup`).

    Attributes:
        received: Number of the first signal, 0 for none.
        impatient: Whether there was a second one.
    """

    def __init__(
        self,
        first: Callable[[int], None] = lambda _: None,
        later: Callable[[int], None] = lambda _: None,
        *,
        losing: bool = False,
    ) -> None:
        self.received: int = 0
        self.impatient = False
        self._first = first
        self._later = later
        # Not a threading.Event: a handler that is called while the main thread holds its lock would wait forever.
        self._pipe, self._bell = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        caught = [n for n in LOSING if losing and signal.getsignal(n) is not signal.SIG_IGN]
        for number in (*ENDING, *caught):
            signal.signal(number, self._handle)

    @property
    def exit_code(self) -> int:
        """0 after an orderly end; after a second signal, the code that shells expect of a program that it ended."""
        return 128 + self.received if self.impatient else 0

    def wait(self, seconds: float) -> None:
        """Wait; end early if a signal comes or has come since the last wait."""
        if select.select([self._pipe], [], [], seconds)[0]:
            os.read(self._pipe, 4096)

    def _handle(self, number: int, _: FrameType | None) -> None:
        _ring(self._bell)
        if self.received:
            self.impatient = True
            self._later(number)
        else:
            self.received = number
            self._first(number)


def insist(_: int) -> None:
    """Interrupt the main thread because of a second signal, and ignore all further ones.

    Raises:
        SecondSignal: Always.
    """
    ignore_signals()
    raise SecondSignal


def ignore_signals() -> None:
    """Ignore further signals during the little work that is left."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)


def _ring(bell: int) -> None:
    try:
        os.write(bell, b"\0")
    except BlockingIOError:  # thousands of signals without a wait
        return
