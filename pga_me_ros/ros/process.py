"""Start and end of a node's process: errors in one line, no traceback on Ctrl-C."""

from __future__ import annotations

import gc
import sys
import traceback
from collections.abc import Callable

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.executors import ExternalShutdownException
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.dependencies import EXIT_BAD_INPUT, missing_dependency
from pga_me_ros.errors import PgaError
from pga_me_ros.process.parent_watch import wait_for_word
from pga_me_ros.process.signals import Signals
from pga_me_ros.process.streams import tell
from pga_me_ros.ros.command_line import Program, start
from pga_me_ros.ros.spinning import EndingNode, spin

EXIT_FAULT = 1


def run_node(
    program: Program,
    make: Callable[[], EndingNode],
    args: list[str] | None = None,
    *,
    last_words: bool = False,
) -> int:
    """Run a node until it is told to stop.

    Args:
        program: Description of the executable.
        make: Makes the node; called after ``rclpy.init``.
        args: Command line without the program's name; None for that of this process.
        last_words: Whether the node publishes something when it is destroyed: ROS 2 then stays up after a signal, also
            of a terminal that is closed, until it is. For a node with a timer, which lets Python notice signals.

    Returns:
        Exit code: 0 after a shutdown, 2 for bad input, 1 for a fault.
    """
    node: EndingNode | None = None
    started = running = False

    def tell_to_end(_: int) -> None:
        if node is None:  # it is just being made
            raise KeyboardInterrupt
        node.end(ExternalShutdownException())

    try:
        wait_for_word()
        options = {"signal_handler_options": SignalHandlerOptions.NO} if last_words else {}
        if not start(program, args, **options):
            return 0
        started = True
        if last_words:
            Signals(tell_to_end, losing=True)
        node = make()
        running = True
        spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except Exception as error:
        due_to_signal = started and not rclpy.ok() and not isinstance(error, PgaError)
        if due_to_signal and (isinstance(error, RCLError) or not running):
            return 0  # ROS 2 was shut down in the middle of some work
        return report(error, starting=not running)
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
        if started and node is None:
            gc.collect()  # others would still see, and ask, what there is of a node that could not be made
    return 0


def report(error: Exception, *, starting: bool = True) -> int:
    """Print an error for a user and return its exit code.

    Args:
        error: The error.
        starting: Whether the node was still starting: errors of ROS, memory or permissions are then due to the user's
            input.
    """
    error = missing_dependency(error) or error
    if isinstance(error, PgaError):
        tell(f"error: {error}", sys.stderr)
        return EXIT_BAD_INPUT
    if starting and isinstance(error, RCLError):
        tell(f"error: ROS 2 could not start: {_one_line(error)}", sys.stderr)
        return EXIT_BAD_INPUT
    if starting and isinstance(error, MemoryError):
        tell(
            f"error: memory cannot hold what the settings need ({_one_line(error)}); reduce controller_hidden, "
            "critic_hidden, cells, batch_size or replay_size.",
            sys.stderr,
        )
        return EXIT_BAD_INPUT
    if starting and isinstance(error, PermissionError) and error.filename:
        tell(
            f"error: '{error.filename}': {error.strerror}; check path and permissions.", sys.stderr
        )
        return EXIT_BAD_INPUT
    tell("".join(traceback.format_exception(error)), sys.stderr, end="")
    return EXIT_FAULT


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
