"""What the nodes of a run tell about themselves: progress, diagnostics and log."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from pga_me_msgs.msg import Progress
from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import QoSProfile

from pga_me_ros.explorer.description import plain
from pga_me_ros.ros import names, qos

LOG_LINES = 60
"""Last lines of the log that the page shows."""

SHOWN = (
    *("state", "generation", "generations", "evaluations", "budget", "rate", "eta"),
    *("coverage", "cells", "qd_score", "max_fitness", "evaluators", "restarts"),
    *("final_reevaluations", "final_budget"),
)
"""Fields of `Progress` that the page shows."""


class RunWatch:
    """Listens to the nodes of a run, while another thread spins its own.

    Args:
        node: Node that subscribes; those in its namespace are listened to.
    """

    def __init__(self, node: Node) -> None:
        self._namespace = node.get_namespace().rstrip("/")
        self._lock = threading.Lock()
        self._progress: dict[str, Any] | None = None
        self._last_progress = 0.0
        self._nodes: dict[str, dict[str, str]] = {}
        self._log: deque[str] = deque(maxlen=LOG_LINES)
        node.create_subscription(Progress, names.PROGRESS, self._on_progress, qos.LATCHED)
        node.create_subscription(
            DiagnosticArray, names.DIAGNOSTICS, self._on_diagnostics, qos.DIAGNOSTICS
        )
        node.create_subscription(Log, "/rosout", self._on_log, QoSProfile(depth=100))

    @property
    def silent(self) -> float:
        """Seconds since the orchestrator's last message, 0 if there was none."""
        return time.monotonic() - self._last_progress if self._last_progress else 0.0

    def state(self) -> dict[str, Any]:
        """Return what was heard, fit for JSON."""
        with self._lock:
            return {
                "progress": self._progress,
                "nodes": [{"node": name, **values} for name, values in sorted(self._nodes.items())],
                "log": list(self._log),
            }

    def _on_progress(self, msg: Progress) -> None:
        with self._lock:
            self._progress = plain({name: getattr(msg, name) for name in SHOWN})
            self._last_progress = time.monotonic()

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        with self._lock:
            for status in msg.status:
                if status.name.rpartition("/")[0] == self._namespace:
                    values = {pair.key: pair.value for pair in status.values}
                    self._nodes[status.name] = {"says": status.message, **values}

    def _on_log(self, msg: Log) -> None:
        # A logger's name has dots for slashes, and may go on after the node's.
        if f"/{msg.name.replace('.', '/')}".startswith(f"{self._namespace}/"):
            with self._lock:
                self._log.append(f"{msg.name}: {msg.msg}")
