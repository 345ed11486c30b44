"""Signals that end a program: the first is noted, the second may interrupt, further ones have no effect."""

from __future__ import annotations

import signal
import subprocess
import sys

PROGRAM = """
import os
import time

from pga_me_ros.process.signals import SecondSignal, Signals, insist
def tell(what):  # print must not be called by a signal that interrupts it
    os.write(1, f"{what}\\n".encode())
"""


def start(program: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM + program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


def line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_a_signal_ends_a_wait_and_counts_as_the_first() -> None:
    process = start(
        "signals = Signals(lambda n: tell(f'first {n}'), lambda n: tell(f'later {n}'))\n"
        "tell('ready')\n"
        "signals.wait(1e6)\n"
        "tell(f'{signals.received} {signals.impatient} {signals.exit_code}')\n"
        "signals.wait(1e6)\n"
        "tell(f'{signals.received} {signals.impatient} {signals.exit_code}')\n"
    )
    assert line(process) == "ready"
    process.send_signal(signal.SIGTERM)
    assert [line(process), line(process)] == ["first 15", "15 False 0"]
    process.send_signal(signal.SIGINT)
    assert [line(process), line(process)] == ["later 2", "15 True 143"]
    assert process.wait() == 0


def test_a_signal_that_comes_before_a_wait_ends_it() -> None:
    process = start(
        "import os, signal\n"
        "signals = Signals()\n"
        "os.kill(os.getpid(), signal.SIGINT)\n"
        "signals.wait(1e6)\n"
        "start = time.monotonic()\n"
        "signals.wait(0.05)\n"
        "tell(time.monotonic() - start >= 0.05)\n"
    )
    assert line(process) == "True"
    assert process.wait() == 0


def test_the_second_signal_may_interrupt_and_further_ones_have_no_effect() -> None:
    process = start(
        "signals = Signals(later=insist)\n"
        "try:\n"
        "    tell('ready')\n"
        "    while True:\n"
        "        signals.wait(1e6)\n"
        "        tell('asked')\n"
        "except SecondSignal:\n"
        "    tell('interrupted')\n"
        "    input()\n"
    )
    assert line(process) == "ready"
    process.send_signal(signal.SIGINT)
    assert line(process) == "asked"
    process.send_signal(signal.SIGINT)
    assert line(process) == "interrupted"
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGTERM)
    process.communicate("\n")
    assert process.returncode == 0
