"""The demonstration behind ``make run``: grows a small repertoire, then another process asks for gaits and runs them.

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
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import FrameType

import rclpy
from pga_me_msgs.msg import Progress
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.core.errors import SettingsError, nearest_name
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.environment import prepare_environment
from pga_me_ros.ros.process import report

EVALUATIONS = 5000
"""Budget unless the command line names one: two or three minutes of the walker on two cores."""

PR_SET_PDEATHSIG = 1
"""From Linux' prctl.h."""

TICK = 0.2
"""Seconds between two looks at whether the orchestrator still lives."""


@dataclass(frozen=True)
class Arguments:
    """The command line, taken apart.

    Attributes:
        orchestrator: ROS arguments of the orchestrator.
        remaps: Those of them that rename: the robot needs them too, to find the repertoire.
        serve: Whether the user wants the repertoire to be served on afterwards.
    """

    orchestrator: list[str]
    remaps: list[str]
    serve: bool

    @classmethod
    def parse(cls, words: Sequence[str]) -> Arguments:
        """Read the command line.

        Raises:
            SettingsError: A params file does not exist.
        """
        given = [word for word in words if word != "--ros-args"]
        remaps: list[str] = []
        for i, (flag, value) in enumerate(pairwise(given), start=1):
            if flag == "--params-file":
                given[i] = str(find_config(value))
            elif flag in ("-r", "--remap"):
                remaps += [flag, value]
        # Behind the task's own file, but before whatever the user adds: of two values the later one counts.
        place = 2 if given[:1] == ["--params-file"] else 0
        given[place:place] = ["-p", f"evaluations:={EVALUATIONS}"]
        serve = "serve:=true" in given
        return cls(["--ros-args", *given, "-p", "serve:=true"], remaps, serve)


def find_config(given: str) -> Path:
    """Return a params file: as it is given, or that of the same name among the configurations that came with us.

    Raises:
        SettingsError: There is none.
    """
    path = Path(given)
    if path.is_file():
        return path
    known: dict[str, Path] = {}
    for folder in _config_folders():  # the first folder that has it counts
        for file in sorted(folder.glob("*.yaml")):
            known.setdefault(file.stem, file)
    if path.stem in known and not path.is_absolute():
        return known[path.stem]
    raise SettingsError(
        f"There is no params file '{given}'{nearest_name(path.stem, known)}; there are configurations for "
        f"{', '.join(known) or 'no task'} (make run TASK=NAME)."
    )


def _config_folders() -> Iterator[Path]:
    checkout = Path(__file__).resolve().parents[1] / "config"
    if checkout.is_dir():
        yield checkout
    from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

    with suppress(PackageNotFoundError):
        yield Path(get_package_share_directory("pga_me_ros")) / "config"


class Signals:
    """Hands signals on to the children: they sit in sessions of their own, so that each arrives exactly once."""

    def __init__(self) -> None:
        self.received = 0
        self.children: list[subprocess.Popen[bytes]] = []
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._handle)

    def _handle(self, number: int, _: FrameType | None) -> None:
        self.received = self.received or number
        for child in self.children:
            if child.poll() is None:
                child.send_signal(number)

    @property
    def exit_code(self) -> int:
        """What a shell expects of a program that a signal ended; 0 for none."""
        return 128 + self.received if self.received else 0


def start(module: str, arguments: Sequence[str]) -> subprocess.Popen[bytes]:
    """Start a module in this terminal, in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=_end_with_parent,
    )


def _end_with_parent() -> None:
    """Have the kernel send SIGTERM to the process to be started when this one is gone, however it ends."""
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
    # A name given to the orchestrator on the command line is not ours.
    node = rclpy.create_node("demo", cli_args=["--ros-args", "-r", "__node:=demo"])

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


def demonstrate(arguments: Arguments, signals: Signals) -> int:
    """Grow a repertoire, then have a robot of another process ask for gaits and run them.

    Returns:
        Exit code.
    """
    orchestrator = start("pga_me_ros.nodes.orchestrator", arguments.orchestrator)
    signals.children.append(orchestrator)
    try:
        with listening(orchestrator.pid, arguments.remaps) as finished:
            while not finished.wait(TICK):
                if orchestrator.poll() is not None:
                    return orchestrator.returncode
        robot = start("pga_me_ros.demo_robot", ["--ros-args", *arguments.remaps])
        signals.children.append(robot)
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
    signals = Signals()
    try:
        prepare_environment()
        return demonstrate(Arguments.parse(sys.argv[1:]), signals)
    except Exception as error:
        return report(error)


if __name__ == "__main__":
    sys.exit(main())
