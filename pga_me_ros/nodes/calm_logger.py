"""The logger of a node that shows a line of progress."""

from __future__ import annotations

from typing import Any

from rclpy.impl.rcutils_logger import RcutilsLogger

from pga_me_ros.core.terminal import Terminal


class CalmLogger:
    """A node's logger that takes the line of progress out of its way.

    Args:
        logger: The logger of rclpy.
        terminal: Where progress is shown.
    """

    def __init__(self, logger: RcutilsLogger, terminal: Terminal) -> None:
        self._logger = logger
        self._terminal = terminal

    def __getattr__(self, name: str) -> Any:
        """Everything else is the logger's own."""
        return getattr(self._logger, name)

    # A method each: rclpy remembers a severity for every line of code that logs.
    def info(self, message: str) -> None:
        """Log what is good to know."""
        self._terminal.note(message)
        with self._terminal.aside():
            self._logger.info(message)

    def warning(self, message: str) -> None:
        """Log what the run copes with."""
        self._terminal.note(f"warning: {message}")
        with self._terminal.aside():
            self._logger.warning(message)

    def warn(self, message: str) -> None:
        """Log what it copes with, as rclpy itself does."""
        self.warning(message)

    def fatal(self, message: str) -> None:
        """Log a fault, as rclpy does of what a callback raises."""
        self._terminal.note(f"fatal: {message}")
        with self._terminal.aside():
            self._logger.fatal(message)

    def error(self, message: str) -> None:
        """Log what it does not cope with."""
        self._terminal.note(f"error: {message}")
        with self._terminal.aside():
            self._logger.error(message)
