"""Orchestrator: starts, watches and stops the other nodes, and leads a run from start to end."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import rclpy
from pga_me_msgs.msg import NodeStatus, Progress
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.core.errors import PgaError
from pga_me_ros.core.run_directory import RunDirectory, default_run_dir, open_run
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage_file import explained
from pga_me_ros.nodes.caller import StoppedError, Waiter
from pga_me_ros.nodes.control import Control
from pga_me_ros.nodes.options import RunOptions
from pga_me_ros.nodes.progress import ProgressReporter
from pga_me_ros.nodes.run import Run
from pga_me_ros.nodes.team import SINGLETONS, name_is_taken
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program, start
from pga_me_ros.ros.namesakes import LISTEN, LISTEN_ON, listening_time
from pga_me_ros.ros.process import report
from pga_me_ros.ros.refusals import printable
from pga_me_ros.ros.spinning import spin
from pga_me_ros.tasks.registry import task_spec

HEARTBEAT = 1.0
"""Seconds between two messages on progress and diagnostics."""


class Signals:
    """Ctrl-C and SIGTERM: the first asks the run to stop, the second ends everything at once, more change nothing.

    Args:
        control: The orchestrator's node.

    Attributes:
        received: Number of the first signal, 0 for none.
        impatient: Whether there was a second one.
    """

    def __init__(self, control: Control) -> None:
        self._control = control
        self.received: int = 0
        self.impatient = False
        signal.signal(signal.SIGINT, self._handle)
        signal.signal(signal.SIGTERM, self._handle)

    def _handle(self, number: int, _: FrameType | None) -> None:
        if self.received:
            self.impatient = True
            self.ignore()
            raise SecondSignal
        self.received = number
        self._control.stop_requested.set()

    def ignore(self) -> None:
        """Let no further signal interrupt what is left to do, which is little."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)

    @property
    def exit_code(self) -> int:
        """What a shell expects of a program that a signal ended; 0 for none."""
        return 128 + self.received if self.received else 0


class SecondSignal(BaseException):
    """The user does not want to wait any longer."""


def lead(control: Control, signals: Signals) -> int:
    """Carry out the run that the node's parameters ask for.

    Returns:
        Exit code.

    Raises:
        PgaError: The run cannot start or go on.
    """
    settings, options = control.settings, control.options
    spec = task_spec(settings.task)
    progress = ProgressReporter(control)
    progress.msg.task = settings.task
    progress.publish()
    path = Path(options.run_dir) if options.run_dir else default_run_dir(settings)
    require_free_name(control, progress.msg, new=not path.exists())
    directory = open_run(path, spec, settings)
    with explained(path):
        control.terminal.record(path / "logs" / "orchestrator.log")
    control.take_rates(directory.settings)
    run = Run(control, spec, directory, options, progress)

    def beat() -> None:
        progress.publish()
        run.watch.publish(progress.msg)

    # Steady: anybody may set use_sim_time, and a simulated clock may stand still.
    timer = control.create_timer(HEARTBEAT, beat, clock=Clock(clock_type=ClockType.STEADY_TIME))
    progress.say(started(directory))
    try:
        run.grow()
        progress.say(finished(directory, run))
        if options.serve:
            progress.say("serving it as repertoire/get_behavior; Ctrl-C ends")
            run.serve()
    except StoppedError:
        if progress.msg.state != "finished":
            progress.enter("stopping")
            progress.say(stopped(progress, directory, run))
            return signals.exit_code
    except PgaError as error:
        progress.enter("failed")
        run.watch.failed(str(error))
        control.terminal.note(f"error: {error}")
        run.watch.publish(progress.msg)
        if progress.msg.evaluations:
            progress.say(failed(progress, directory, run))
        raise
    finally:
        timer.cancel()
        control.terminal.close()
        end(run, directory, at_once=signals.impatient)
    return 0


def lead_until_told(control: Control, signals: Signals) -> int:
    """Carry out the run, or as much of it as signals leave time for, and return the exit code."""
    try:
        return lead(control, signals)
    except (StoppedError, SecondSignal):
        return signals.exit_code
    finally:
        signals.ignore()


def end(run: Run, directory: RunDirectory, *, at_once: bool) -> None:
    """Stop all children; a second Ctrl-C kills them."""
    try:
        run.end(at_once=at_once)
    except SecondSignal:
        run.end(at_once=True)
    directory.lock.release()


def started(directory: RunDirectory) -> str:
    """Return the words for a run that begins or goes on."""
    done, wanted = directory.next_generation, directory.settings.generations
    if not done:
        return f"new run in {directory.path}"
    if done < wanted:
        return f"resumed the run in {directory.path} after generation {done} of {wanted}"
    return f"the run in {directory.path} has reached its budget before: {done} generations"


def finished(directory: RunDirectory, run: Run) -> str:
    """Return the words for a run that has reached its budget."""
    return f"finished: {directory.repertoire} ({run.summary})"


def stopped(progress: ProgressReporter, directory: RunDirectory, run: Run) -> str:
    """Return the words for a run that was stopped."""
    return (
        f"stopped: {progress.msg.evaluations} evaluations are safe in {directory.repertoire} "
        f"({run.summary}); the same command resumes"
    )


def failed(progress: ProgressReporter, directory: RunDirectory, run: Run) -> str:
    """Return the words for a run that cannot go on."""
    return (
        f"failed: {progress.msg.evaluations} evaluations are safe in {directory.repertoire} "
        f"({run.summary}); once the cause below is mended, the same command resumes"
    )


def require_free_name(control: Control, claim: Progress, *, new: bool) -> None:
    """Make sure that no other orchestrator lives in this namespace.

    Of several that are started at the same time, the one whose claim is the oldest stays.

    Args:
        control: The orchestrator's node.
        claim: What it has published of itself, without a run yet.
        new: Whether the run's folder is still to be made; nobody else's nodes may then be there either. Of a run that
            is resumed they may be its own, about to notice that their orchestrator was killed.

    Raises:
        PgaError: One does.
    """
    heard: list[Progress] = []
    strangers: list[NodeStatus] = []
    waiter = Waiter(lambda: stop_if_asked(control))

    def take(msg: Progress) -> None:
        if (
            not heard
            and (msg.host, msg.pid) != (socket.gethostname(), os.getpid())
            and (msg.run_id or age(msg) < age(claim))
        ):
            heard.append(msg)
            waiter.wake()

    def take_node(msg: NodeStatus) -> None:
        if new and not strangers and msg.kind in SINGLETONS:
            strangers.append(msg)

    control.create_subscription(Progress, names.PROGRESS, take, qos.LATCHED)
    control.create_subscription(NodeStatus, names.STATUS, take_node, qos.STATUS)
    waiter.until(lambda: bool(heard), LISTEN)
    waiter.until(lambda: bool(heard), listening_time(control, control.get_name()) - LISTEN)
    if strangers:  # their orchestrator, if they have one, says more about them
        waiter.until(lambda: bool(heard), LISTEN_ON)
    if heard:
        who = printable(f"process {heard[0].pid} on {heard[0].host}, task {heard[0].task}")
        raise PgaError(
            f"Another orchestrator runs as {control.get_fully_qualified_name()} ({who}). "
            "Stop it, or give this one a namespace (--ros-args -r __ns:=/NAME) or another ROS_DOMAIN_ID."
        )
    if strangers:
        raise name_is_taken(strangers[0])


def stop_if_asked(control: Control) -> None:
    """End a wait when the user asked to stop.

    Raises:
        StoppedError: The user did.
    """
    if control.stop_requested.is_set():
        raise StoppedError


def age(claim: Progress) -> tuple[int, int, str, int]:
    """Return what orders claims to a name: the smallest is the oldest."""
    return claim.stamp.sec, claim.stamp.nanosec, claim.host, claim.pid


@contextmanager
def spinning(control: Control) -> Iterator[list[int]]:
    """Serve a node's callbacks in another thread; a fault in one stops the run and gives an exit code."""
    faults: list[int] = []

    def serve() -> None:
        try:
            spin(control)
        except ExternalShutdownException:
            return
        except Exception as error:  # without this thread, nothing would ever be answered
            faults.append(report(error))
            control.stop_requested.set()

    thread = threading.Thread(target=serve, name="executor")
    thread.start()
    try:
        yield faults
    finally:
        control.end(ExternalShutdownException())
        thread.join()


PROGRAM = Program(
    "orchestrator",
    "Grows a repertoire by PGA-MAP-Elites: starts the other nodes, leads the run and serves what it found. "
    "The same command resumes a run that was stopped.",
    (Settings, RunOptions),
)


def main() -> int:
    """Run the orchestrator."""
    try:
        if not start(PROGRAM, signal_handler_options=SignalHandlerOptions.NO):
            return 0
        control = Control()
        signals = Signals(control)
        with spinning(control) as faults:
            code = lead_until_told(control, signals)
        return faults[0] if faults else code
    except KeyboardInterrupt:
        return 128 + signal.SIGINT
    except BrokenPipeError:  # whoever read our output has left, as `| head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 128 + signal.SIGPIPE
    except Exception as error:
        return report(error)
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    raise SystemExit(main())
