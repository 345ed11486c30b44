"""Leads a run from start to end, and reports how it starts, ends and stops."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException

from pga_me_ros.core.plan import batch_lines
from pga_me_ros.core.runs.run_directory import RunDirectory, default_run_dir, open_run
from pga_me_ros.core.storage.database import explained
from pga_me_ros.core.storage.event_file import require_event_writer, write_events
from pga_me_ros.errors import PgaError
from pga_me_ros.orchestration.calls import StoppedError
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.early_start import EarlyStart
from pga_me_ros.orchestration.free_name import name_on_this_machine, require_free_name
from pga_me_ros.orchestration.progress import ProgressReporter
from pga_me_ros.orchestration.run import Run
from pga_me_ros.process.signals import SecondSignal, Signals, ignore_signals
from pga_me_ros.ros.process import report
from pga_me_ros.ros.spinning import spin
from pga_me_ros.tasks.registry import randomization_option, task_spec

HEARTBEAT = 1.0
"""Seconds between two messages on progress and diagnostics."""


def lead(control: Control, signals: Signals) -> int:
    """Carry out the run that the node's parameters describe.

    Returns:
        Exit code.

    Raises:
        PgaError: The run cannot start or continue.
    """
    settings, options = control.settings, control.options
    spec = task_spec(settings.task)
    if control.options.tensorboard:
        require_event_writer()
    randomization_option(settings.task, settings.randomization)  # refuses what makes no sense
    path = Path(options.run_dir) if options.run_dir else default_run_dir(settings)
    with ExitStack() as held:
        held.enter_context(name_on_this_machine(control))
        progress = ProgressReporter(control)
        progress.msg.task = settings.task
        progress.publish()
        early = held.enter_context(EarlyStart(control, path, spec))
        if early.words:
            progress.say(early.words)
        require_free_name(control, progress.msg, new=not path.exists())
        early.finish()
        directory = open_run(path, spec, settings)
        with explained(path):
            control.terminal.record(path / "logs" / "orchestrator.log")
        control.take_rates(directory.settings)
        run = Run(control, spec, directory, options, progress, early.processes)
        return carry_out(run, directory, control, progress, signals)


def carry_out(
    run: Run,
    directory: RunDirectory,
    control: Control,
    progress: ProgressReporter,
    signals: Signals,
) -> int:
    """Carry out a run, serve what it found, and say how it ended.

    Returns:
        Exit code.

    Raises:
        PgaError: The run cannot continue.
    """

    def beat() -> None:
        progress.publish()
        run.watch.publish(progress.msg)

    # A steady clock: anybody may set use_sim_time, and a simulated clock may stand still.
    timer = control.create_timer(HEARTBEAT, beat, clock=Clock(clock_type=ClockType.STEADY_TIME))
    progress.say(started(directory))
    if control.options.tensorboard and directory.next_generation >= directory.settings.generations:
        write_events(directory.repertoire, control.get_logger().warning)
    for line in batch_lines(directory.settings, len(directory.imported)):
        progress.say(line)
    try:
        run.grow()
        progress.say(finished(directory, run))
        if control.options.serve:
            progress.say("serving it as repertoire/get_behavior; Ctrl-C to end")
            run.serve()
    except StoppedError:
        if progress.msg.state != "finished":
            progress.enter("stopping")
            progress.say(stopped(progress, directory, run))
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
    return signals.exit_code  # a further signal may have come until now


def lead_until_told(control: Control, signals: Signals) -> int:
    """Carry out the run, or as much of it as signals leave time for, and return the exit code."""
    try:
        return lead(control, signals)
    except (StoppedError, SecondSignal):
        return signals.exit_code
    finally:
        ignore_signals()


def end(run: Run, directory: RunDirectory, *, at_once: bool) -> None:
    """Stop all children; a second Ctrl-C kills them."""
    try:
        run.end(at_once=at_once)
    except SecondSignal:
        run.end(at_once=True)
    directory.lock.release()


def started(directory: RunDirectory) -> str:
    """Return the line for a run that starts or resumes."""
    done, wanted = directory.next_generation, directory.settings.generations
    if not done:
        return f"new run in {directory.path}"
    if done < wanted:
        return f"resumed the run in {directory.path} after generation {done} of {wanted}"
    return f"the run in {directory.path} has already reached its budget: {done} generations"


def finished(directory: RunDirectory, run: Run) -> str:
    """Return the line for a run that has reached its budget."""
    return f"finished: {directory.repertoire} ({run.summary})"


def stopped(progress: ProgressReporter, directory: RunDirectory, run: Run) -> str:
    """Return the line for a run that was stopped."""
    return (
        f"stopped: {progress.msg.evaluations} evaluations are safe in {directory.repertoire} "
        f"({run.summary}); the same command resumes"
    )


def failed(progress: ProgressReporter, directory: RunDirectory, run: Run) -> str:
    """Return the line for a run that has failed."""
    return (
        f"failed: {progress.msg.evaluations} evaluations are safe in {directory.repertoire} "
        f"({run.summary}); once the cause below is fixed, the same command resumes"
    )


@contextmanager
def spinning(control: Control) -> Iterator[list[int]]:
    """Serve a node's callbacks in another thread; a fault in one stops the run and adds an exit code to the list."""
    faults: list[int] = []

    def serve() -> None:
        try:
            spin(control)
        except ExternalShutdownException:
            return
        except Exception as error:  # without this thread, no request would ever be answered
            faults.append(report(error))
            control.stop_requested.set()

    thread = threading.Thread(target=serve, name="executor")
    thread.start()
    try:
        yield faults
    finally:
        control.end(ExternalShutdownException())
        thread.join()
