"""The demonstration behind ``make run``: grows a small repertoire, then another process requests gaits and runs them.

``python -m pga_me_ros.demo [--params-file FILE] [ROS arguments for the orchestrator]``
"""

from __future__ import annotations

import ctypes
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

import rclpy
from pga_me_msgs.msg import Progress
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.demo.arguments import Arguments
from pga_me_ros.process.signals import Signals
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.environment import prepare_environment
from pga_me_ros.ros.process import report
from pga_me_ros.ros.spinning import EndingNode

PR_SET_PDEATHSIG = 1
"""From Linux's prctl.h."""

TICK = 0.2
"""Seconds between two checks whether the orchestrator is alive."""


class Children:
    """Processes of the demonstration, each in its own session, so that a signal reaches it only once."""

    def __init__(self) -> None:
        self._processes: list[subprocess.Popen[bytes]] = []

    def start(self, module: str, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
        """Start a module in this terminal."""
        process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=_end_with_parent,
        )
        self._processes.append(process)
        return process

    def send(self, number: int) -> None:
        """Forward a signal to those that are alive."""
        for process in self._processes:
            if process.poll() is None:
                process.send_signal(number)


def _end_with_parent() -> None:
    """Make the kernel send SIGTERM to the new process when this one ends, however it ends."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, int(signal.SIGTERM))


@contextmanager
def listening(pid: int, remaps: Sequence[str]) -> Iterator[threading.Event]:
    """Listen for the end of a run.

    Args:
        pid: Process id of its orchestrator.
        remaps: ROS arguments that give the orchestrator its namespace.

    Yields:
        Event that is set when the run has reached its budget.
    """
    event = threading.Event()
    rclpy.init(args=["demo", "--ros-args", *remaps], signal_handler_options=SignalHandlerOptions.NO)
    # A node name given on the command line is the orchestrator's, not ours.
    node = EndingNode("demo", cli_args=["--ros-args", "-r", "__node:=demo"])

    def hear(msg: Progress) -> None:
        if (msg.host, msg.pid) == (socket.gethostname(), pid) and msg.state == "finished":
            event.set()

    node.create_subscription(Progress, names.PROGRESS, hear, qos.LATCHED)
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin() -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    thread = threading.Thread(target=spin, name="progress")
    thread.start()
    try:
        yield event
    finally:
        executor.shutdown()
        thread.join()
        node.destroy_node()
        rclpy.try_shutdown()


def demonstrate(arguments: Arguments, children: Children, signals: Signals) -> int:
    """Grow a repertoire, then have a robot in another process request gaits and run them.

    Returns:
        Exit code.
    """
    orchestrator = children.start("pga_me_ros.nodes.orchestrator", arguments.orchestrator)
    try:
        with listening(orchestrator.pid, arguments.remaps) as finished:
            while not finished.wait(TICK):
                if orchestrator.poll() is not None:
                    return orchestrator.returncode
        robot = children.start("pga_me_ros.demo.robot", ["--ros-args", *arguments.remaps])
        code = robot.wait()
        if arguments.serve and not signals.received:
            return orchestrator.wait()
        return signals.exit_code or code
    finally:
        stop(orchestrator)


def stop(orchestrator: subprocess.Popen[bytes]) -> None:
    """End the orchestrator, which ends its own children."""
    if orchestrator.poll() is None:
        orchestrator.send_signal(signal.SIGINT)
    orchestrator.wait()


def main() -> int:
    """Run the demonstration."""
    children = Children()
    signals = Signals(children.send, children.send)
    try:
        prepare_environment()
        return demonstrate(Arguments.parse(sys.argv[1:]), children, signals)
    except Exception as error:
        return report(error)


if __name__ == "__main__":
    sys.exit(main())
