"""Ctrl-C and SIGTERM while a node or program is still importing its libraries, which takes a second."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

from pga_me_ros.process.signals import ENDING

PREFIX = "pga_me_ros."

USUAL: dict[signal.Signals, Any] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
}
"""Python's own handlers."""


UNTIL_STOPPED = ("nodes.", "demo", "explorer")
"""Beginnings of the names of programs that run until they are stopped, so that a signal is their orderly end."""


def own_program() -> str:
    """Return which of the package's nodes or programs this process is, while it is about to import it, or ''.

    It was started as ``python -m pga_me_ros.NAME``, or by the script NAME that pip installs for it; the name of a node
    begins with ``nodes.``.
    """
    words = sys.orig_argv
    if sys.argv[:1] == ["-m"] and "-m" in words[:-1]:  # Python sets the first word afterwards
        module = words[words.index("-m") + 1]
        return module.removeprefix(PREFIX) if module.startswith(PREFIX) else ""
    package, name = Path(__file__).parents[1], Path(sys.argv[0] if sys.argv else "").name
    if name.isidentifier() and (package / "nodes" / f"{name}.py").is_file():
        return f"nodes.{name}"
    return name if name.isidentifier() and (package / name / "__main__.py").is_file() else ""


def end_on_early_signals(program: str) -> None:
    """End this process at once on signals that come before `hand_over`.

    Nothing is open yet that would have to be closed. Signals that are ignored stay so. The exit status is 0 for a
    program that runs until it is stopped, else 128 + the signal's number.

    Args:
        program: Its name, as `own_program` returns it.
    """
    handler = _end if program.startswith(UNTIL_STOPPED) else _break_off
    for number, usual in USUAL.items():
        if signal.getsignal(number) == usual:
            signal.signal(number, handler)


def hand_over() -> None:
    """Return to Python's own handlers, where `end_on_early_signals` has set others."""
    for number in ENDING:
        if signal.getsignal(number) in (_end, _break_off):
            signal.signal(number, USUAL[number])


def _end(_: int, __: FrameType | None) -> None:
    _exit(0)


def _break_off(number: int, _: FrameType | None) -> None:
    _exit(128 + number)


def _exit(status: int) -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):  # lost, or just being written to
            stream.flush()
    os._exit(status)
