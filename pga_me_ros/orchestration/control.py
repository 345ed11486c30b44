"""The orchestrator's own node: parameters, pause, resume, stop."""

from __future__ import annotations

import threading
import time
from typing import Any

from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.errors import SettingsError
from pga_me_ros.process.terminal import Terminal
from pga_me_ros.ros import names
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameters import declare_run, on_change
from pga_me_ros.ros.refusals import CalmRefusals
from pga_me_ros.ros.shield import shield
from pga_me_ros.ros.spinning import EndingNode


class Control(EndingNode):
    """What the user controls: the run's rates, pause, resume and stop.

    Attributes:
        settings: Settings with the rates for the next generation.
        options: How the run is carried out.
        stop_requested: Set when the run should end.
        paused: Set while no new generation may begin.
        terminal: Where progress is shown.
        began: Time on the monotonic clock from which this node and others can discover each other.
    """

    def __init__(self) -> None:
        self.terminal = Terminal()
        super().__init__("orchestrator", automatically_declare_parameters_from_overrides=True)
        self.began = time.monotonic()
        self._refusals = CalmRefusals()
        shield(self, self.refused)
        self.settings, options = declare_run(self, RunOptions)
        self.options = RunOptions(**options)
        self.stop_requested = threading.Event()
        self.paused = threading.Event()
        self.create_service(Trigger, names.PAUSE, self._pause)
        self.create_service(Trigger, names.RESUME, self._resume)
        self.create_service(Trigger, names.STOP, self._stop)
        self._early: dict[str, Any] | None = {}  # rates that were set before the run was open
        on_change(self, self._changed, self._change)

    def get_logger(self) -> RcutilsLogger | CalmLogger:
        """Return a logger that does not write into the progress line."""
        return CalmLogger(super().get_logger(), self.terminal)

    def refused(self, reason: str) -> None:
        """Log that a request or message was refused; many are limited to one line per second."""
        line = self._refusals.line(reason)
        if line is not None:
            self.get_logger().warning(line)

    def take_rates(self, settings: Settings) -> None:
        """Take over the rates in force of a resumed run, so that the parameters show them.

        Those that were set since the start stay as they were set.

        Raises:
            SettingsError: They do not fit those of the run.
        """
        early, self._early = self._early or {}, None
        settings = settings.replace(**early)
        changed = [n for n in RATES if getattr(settings, n) != getattr(self.settings, n)]
        self.set_parameters([Parameter(n, value=getattr(settings, n)) for n in changed])
        self.settings = settings

    def _changed(self, changes: dict[str, Any]) -> Settings:
        """Return the settings after a change of rates.

        Raises:
            SettingsError: A value is out of range or does not fit the others.
        """
        fixed = [name for name in changes if name not in RATES]
        if fixed:
            raise SettingsError(
                f"{', '.join(fixed)} cannot be changed during a run; these can: {', '.join(RATES)}."
            )
        return self.settings.replace(**changes)

    def _change(self, changes: dict[str, Any]) -> None:
        self.settings = self._changed(changes)
        if self._early is not None:
            self._early |= changes
        listed = ", ".join(f"{name} = {value}" for name, value in changes.items())
        self.get_logger().info(f"from the next generation: {listed}")

    def _pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.paused.set()
        response.success, response.message = True, "pauses after the current generation"
        return response

    def _resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self.paused.is_set()
        response.message = "continued" if response.success else "was not paused"
        self.paused.clear()
        return response

    def _stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.stop_requested.set()
        response.success, response.message = True, "stops; the same command resumes"
        return response


class CalmLogger:
    """A node's logger that first clears the progress line.

    Args:
        logger: The logger of rclpy.
        terminal: Where progress is shown.
    """

    def __init__(self, logger: RcutilsLogger, terminal: Terminal) -> None:
        self._logger = logger
        self._terminal = terminal

    def __getattr__(self, name: str) -> Any:
        """Return any other attribute of rclpy's logger."""
        return getattr(self._logger, name)

    # One method per severity: rclpy ties each line of code that logs to one severity.
    def info(self, message: str) -> None:
        """Log information."""
        self._terminal.note(message)
        with self._terminal.aside():
            self._logger.info(message)

    def warning(self, message: str) -> None:
        """Log a problem that the run can handle."""
        self._terminal.note(f"warning: {message}")
        with self._terminal.aside():
            self._logger.warning(message)

    def warn(self, message: str) -> None:
        """Log a problem that the run can handle, under the name that rclpy uses."""
        self.warning(message)

    def fatal(self, message: str) -> None:
        """Log a fault; rclpy calls this for exceptions in callbacks."""
        self._terminal.note(f"fatal: {message}")
        with self._terminal.aside():
            self._logger.fatal(message)

    def error(self, message: str) -> None:
        """Log a problem that the run cannot handle."""
        self._terminal.note(f"error: {message}")
        with self._terminal.aside():
            self._logger.error(message)
