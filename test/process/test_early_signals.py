"""Ctrl-C and SIGTERM at any time, from the first import on: the exit code is 0 for what runs until it is stopped."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy._rclpy_pybind11 import RCLError

from pga_me_ros.errors import SettingsError
from pga_me_ros.process.early_signals import UNTIL_STOPPED
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.process import run_node

PACKAGE = Path(__file__).resolve().parents[2] / "pga_me_ros"
MODULES = [
    *(f"nodes.{path.stem}" for path in sorted((PACKAGE / "nodes").glob("[a-z]*.py"))),
    *(path.parent.name for path in sorted(PACKAGE.glob("*/__main__.py"))),
    "demo.robot",
    "tasks.check",
]
SIGNALS = pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"]
)
SECONDS = 20.0

PROGRAM = """
from pga_me_ros.process.program import run_program

def work():
    try:
        print("ready", flush=True)
        while True:
            input()
    finally:
        print("tidied up", flush=True)

raise SystemExit(run_program(work, "stopped; it continues from here"))
"""


def catch_ctrl_c() -> None:
    """Undo what a shell does to its background jobs, which ignore Ctrl-C; a test may run in one."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def started(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=catch_ctrl_c,
    )


def handles(process: subprocess.Popen[str], number: signal.Signals) -> bool:
    """Return whether a process catches a signal, as the kernel knows it."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    caught = re.findall(r"^SigCgt:\s*(\w+)", status, re.MULTILINE)
    return bool(caught) and bool(int(caught[0], 16) >> (number - 1) & 1)


@SIGNALS
@pytest.mark.parametrize("module", MODULES)
def test_a_signal_during_the_imports_ends_any_program_quietly(
    module: str, number: signal.Signals
) -> None:
    process = started("-m", f"pga_me_ros.{module}")
    deadline = time.monotonic() + SECONDS
    # Python itself does not catch SIGTERM.
    while not handles(process, signal.SIGTERM):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        threading.Event().wait(0.001)
    process.send_signal(number)
    output = process.communicate(timeout=SECONDS)
    status = 0 if module.startswith(UNTIL_STOPPED) else 128 + number
    assert (process.returncode, *output) == (status, "", "")


def test_signals_of_other_peoples_programs_stay_as_they_are() -> None:
    program = "import signal, pga_me_ros; print(signal.getsignal(15), signal.getsignal(2))"
    output, _ = started("-c", program).communicate(timeout=SECONDS)
    assert output.startswith("0 ")
    assert "default_int_handler" in output


@SIGNALS
def test_a_program_that_is_broken_off_tidies_up_and_does_not_pass_for_done(
    number: signal.Signals,
) -> None:
    process = started("-c", PROGRAM)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    output, errors = process.communicate(timeout=SECONDS)
    assert (process.returncode, output) == (128 + number, "tidied up\n")
    assert errors == "stopped; it continues from here\n"


def test_a_signal_while_a_node_is_made_is_no_error(capfd: pytest.CaptureFixture[str]) -> None:
    def make() -> None:
        rclpy.shutdown()  # as rclpy's handler does
        raise RCLError("the context is invalid")

    with domain_id() as domain, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        assert run_node(Program("x", "", ()), make, []) == 0
        assert capfd.readouterr().err == ""

        def refuse() -> None:
            rclpy.shutdown()
            raise SettingsError("seed is wrong")

        assert run_node(Program("x", "", ()), refuse, []) == 2
        assert capfd.readouterr().err == "error: seed is wrong\n"
