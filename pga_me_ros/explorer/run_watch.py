"""What the nodes of a run tell about themselves: progress, diagnostics and log."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
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

SILENT_AFTER = 5.0
"""Seconds without diagnostics after which a node's figures no longer count; it sends some every second."""

FORGOTTEN_AFTER = 60.0
"""Seconds without diagnostics after which a node is no longer shown."""

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
        clock: Returns seconds since some moment.
    """

    def __init__(self, node: Node, clock: Callable[[], float] = time.monotonic) -> None:
        self._node, self._clock = node, clock
        self._namespace = node.get_namespace().rstrip("/")
        self._lock = threading.Lock()
        self._progress: dict[str, Any] | None = None
        self._last_progress = 0.0
        self._nodes: dict[str, tuple[float, dict[str, str]]] = {}  # when they were heard, and what
        self._loggers: set[str] = set()
        self._log: deque[str] = deque(maxlen=LOG_LINES)
        node.create_subscription(Progress, names.PROGRESS, self._on_progress, qos.LATCHED)
        node.create_subscription(
            DiagnosticArray, names.DIAGNOSTICS, self._on_diagnostics, qos.DIAGNOSTICS
        )
        node.create_subscription(Log, "/rosout", self._on_log, QoSProfile(depth=100))

    @property
    def silent(self) -> float:
        """Seconds since the orchestrator's last message, 0 if there was none."""
        return self._clock() - self._last_progress if self._last_progress else 0.0

    def state(self) -> dict[str, Any]:
        """Return what was heard, fit for JSON."""
        with self._lock:
            return {
                "progress": self._progress,
                "nodes": self._heard(),
                "log": list(self._log),
            }

    def _heard(self) -> list[dict[str, str]]:
        """Return what each node last told of itself, or that it is silent; those that are long gone are left out."""
        rows, now = [], self._clock()
        for name, (heard, values) in sorted(self._nodes.items()):
            silent = now - heard
            if silent > FORGOTTEN_AFTER:
                continue
            told = {"says": f"silent for {silent:.0f} s"} if silent > SILENT_AFTER else values
            rows.append({"node": name, **told})
        return rows

    def _on_progress(self, msg: Progress) -> None:
        with self._lock:
            self._progress = plain({name: getattr(msg, name) for name in SHOWN})
            self._last_progress = self._clock()

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        with self._lock:
            for status in msg.status:
                if status.name.rpartition("/")[0] == self._namespace:
                    values = {pair.key: pair.value for pair in status.values}
                    told = {"says": status.message, **values}
                    self._nodes[status.name] = self._clock(), told

    def _on_log(self, msg: Log) -> None:
        if self._is_own(msg.name):
            with self._lock:
                self._log.append(f"{msg.name}: {msg.msg}")

    def _is_own(self, logger: str) -> bool:
        """Whether a logger is that of a node of this namespace; it has dots for slashes, and may go on after those."""
        parts = logger.split(".")
        possible = {".".join(parts[:k]) for k in range(1, len(parts) + 1)}
        if possible.isdisjoint(self._loggers):
            # Names are only added: the last words of a node may come when it is gone.
            self._loggers.update(
                f"{self._namespace}/{name}"[1:].replace("/", ".")
                for name, namespace in self._node.get_node_names_and_namespaces()
                if namespace.rstrip("/") == self._namespace
            )
        return not possible.isdisjoint(self._loggers)
