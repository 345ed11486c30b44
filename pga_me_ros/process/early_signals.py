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

USUAL: dict[signal.Signals, Any] = {
    signal.SIGINT: signal.default_int_handler,
    signal.SIGTERM: signal.SIG_DFL,
}
"""Python's own handlers."""


def is_own_program() -> bool:
    """Whether this process is one of the package's nodes or programs, and is about to import it.

    It was started as ``python -m pga_me_ros.NAME``, or by the script NAME that pip installs for it.
    """
    words = sys.orig_argv
    if sys.argv[:1] == ["-m"] and "-m" in words[:-1]:  # Python sets the first word afterwards
        return words[words.index("-m") + 1].startswith("pga_me_ros.")
    package, name = Path(__file__).parents[1], Path(sys.argv[0] if sys.argv else "").name
    return name.isidentifier() and any(
        (package / path).is_file() for path in (f"nodes/{name}.py", f"{name}/__main__.py")
    )


def end_on_early_signals() -> None:
    """End this process at once, with exit code 0, on signals that come before `hand_over`.

    Nothing is open yet that would have to be closed. Signals that are ignored stay so.
    """
    for number, usual in USUAL.items():
        if signal.getsignal(number) == usual:
            signal.signal(number, _end)


def hand_over() -> None:
    """Return to Python's own handlers, where `end_on_early_signals` has set others."""
    for number in ENDING:
        if signal.getsignal(number) == _end:
            signal.signal(number, USUAL[number])


def _end(_: int, __: FrameType | None) -> None:
    for stream in (sys.stdout, sys.stderr):
        with suppress(Exception):  # lost, or just being written to
            stream.flush()
    os._exit(0)
