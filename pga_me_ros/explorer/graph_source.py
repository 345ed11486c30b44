"""A running graph as the page shows it, by the services and topics that any robot's node may use."""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from pga_me_msgs.msg import Metrics, Progress
from rcl_interfaces.msg import Log
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.client import RepertoireClient, RepertoireInfo
from pga_me_ros.core.operators import OPERATORS, Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import PgaError, RequestError
from pga_me_ros.explorer.description import describe_cells, describe_elites, describe_spec, plain
from pga_me_ros.explorer.served_archive import served_archive, spec_of
from pga_me_ros.explorer.steering import ACTIONS, Steering
from pga_me_ros.player.gait import Gait
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program, start

PROGRAM = Program("explorer", "Shows a repertoire in the browser.", ())

LOG_LINES = 60
"""Last lines of the log that the page shows."""

SILENT_AFTER = 5.0
"""Seconds without word from the orchestrator after which the page says so; it speaks once a second."""

CURVES = ("generation", "evaluations", "coverage", "qd_score", "max_fitness", "mean_fitness")


class GraphSource:
    """The repertoire that a graph serves.

    Args:
        ros_args: ``--ros-args`` and what follows, for example a namespace.

    Raises:
        RepertoireTimeoutError: Nobody serves one.
        PgaError: It holds no behavior yet, or the arguments are wrong.
    """

    def __init__(self, ros_args: Sequence[str]) -> None:
        start(PROGRAM, list(ros_args), signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node(PROGRAM.name)
        self._client = RepertoireClient(self._node)
        self._steering = Steering(self._node)
        self._lock = threading.Lock()
        self._progress: dict[str, Any] | None = None
        self._heard = 0.0
        self._curves: dict[str, list[Any]] = {name: [] for name in CURVES}
        self._nodes: dict[str, dict[str, str]] = {}
        self._log: deque[str] = deque(maxlen=LOG_LINES)
        self.version = 0
        self.problem = ""
        self._subscribe()
        self._spinning = threading.Thread(target=self._spin, daemon=True)
        self._spinning.start()
        try:
            info = self._first_generation()
            self.settings = Settings.from_stored(info.settings)
            self._spec, self._known_task = spec_of(info, self.settings)
            self.content: dict[str, Any] = {}
            self._shown = (info.generation, 0)
            self._read()
        except BaseException:
            self.close()
            raise

    def refresh(self) -> None:
        """See `Source`; behaviors are fetched when a generation or re-evaluations have come in."""
        try:
            info = self._client.get_info()
            silent = time.monotonic() - self._heard
            self.problem = ""
            if info.growing and self._heard and silent > SILENT_AFTER:
                self.problem = (
                    f"No message from the run for {silent:.0f} s; the page shows its last state."
                )
            now = (info.generation, info.corrected_repeats)
            if now != self._shown:
                self._read()
                self._shown = now
        except PgaError as error:
            self.problem = f"The graph does not answer: {error} The page shows its last state."

    def state(self) -> dict[str, Any] | None:
        """See `Source`."""
        with self._lock:
            return {
                "progress": self._progress,
                "nodes": [{"node": name, **values} for name, values in sorted(self._nodes.items())],
                "log": list(self._log),
                "rates": self._steering.rates,
                "actions": list(ACTIONS),
            }

    def gait(self, cell: int) -> Gait:
        """See `Source`."""
        return self._client.get_behavior(cell=cell)

    def download(self, cell: int, kind: str) -> bytes:
        """See `Source`."""
        raise RequestError(f"ros2 run pga_me_ros query --cell {cell} --save gait.onnx writes it.")

    def control(self, action: str, values: dict[str, Any]) -> str:
        """See `Source`."""
        return self._steering.carry_out(action, values)

    def close(self) -> None:
        """See `Source`."""
        rclpy.try_shutdown()
        self._spinning.join(5.0)
        self._node.destroy_node()

    def _first_generation(self) -> RepertoireInfo:
        """Return what the repertoire is, once it holds a behavior or no run adds to it."""
        info = self._client.get_info()
        if info.growing and not info.coverage:
            print("waiting for the first generation of the run", file=sys.stderr)
        while info.growing and not info.coverage:
            time.sleep(0.5)
            info = self._client.get_info()
        return info

    def _read(self) -> None:
        """Fetch all behaviors, and describe them.

        Raises:
            RequestError: There is none yet.
        """
        info = self._client.get_info()
        behaviors = list(self._client.list_behaviors(page=10_000)) if info.coverage else []
        if not behaviors:
            raise RequestError(
                "The repertoire that is served holds no behavior; serve another, or run its run for longer."
            )
        archive, known = served_archive(self._spec, self.settings, behaviors)
        with self._lock:
            curves = {name: list(values) for name, values in self._curves.items()}
        self.content = {
            "run": {
                "name": info.task,
                "task": info.task,
                "algorithm": self.settings.algorithm,
                "seed": self.settings.seed,
                "run_id": info.run_id,
                "note": ""
                if self._known_task
                else f"task '{info.task}' is unknown on this machine",
            },
            "spec": describe_spec(self._spec),
            "archive": describe_cells(archive),
            "elites": describe_elites(archive, known),
            "operators": {operator.label: OPERATORS[operator].title for operator in Operator},
            "curves": curves,
            "contributions": _made(archive),
            "corrected": None,
            "measured": [],
            "served": True,
        }
        self.version += 1

    def _subscribe(self) -> None:
        node = self._node
        node.create_subscription(Progress, names.PROGRESS, self._on_progress, qos.LATCHED)
        node.create_subscription(Metrics, names.METRICS, self._on_metrics, qos.LATCHED)
        node.create_subscription(
            DiagnosticArray, names.DIAGNOSTICS, self._on_diagnostics, qos.DIAGNOSTICS
        )
        node.create_subscription(Log, "/rosout", self._on_log, QoSProfile(depth=100))

    def _spin(self) -> None:
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        try:
            while rclpy.ok():
                executor.spin_once(timeout_sec=0.5)
        except ExternalShutdownException:
            pass
        finally:
            executor.shutdown()

    def _on_progress(self, msg: Progress) -> None:
        shown = {
            name: getattr(msg, name)
            for name in (
                *("state", "generation", "generations", "evaluations", "budget", "rate", "eta"),
                *("coverage", "cells", "qd_score", "max_fitness", "evaluators", "restarts"),
                *("final_reevaluations", "final_budget"),
            )
        }
        with self._lock:
            self._progress, self._heard = plain(shown), time.monotonic()

    def _on_metrics(self, msg: Metrics) -> None:
        with self._lock:
            if self._curves["generation"] and msg.generation <= self._curves["generation"][-1]:
                return
            for name in CURVES:
                self._curves[name].append(plain(getattr(msg, name)))

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        with self._lock:
            for status in msg.status:
                values = {pair.key: pair.value for pair in status.values}
                self._nodes[status.name] = {"says": status.message, **values}

    def _on_log(self, msg: Log) -> None:
        with self._lock:
            self._log.append(f"{msg.name}: {msg.msg}")


def _made(archive: Any) -> list[dict[str, Any]]:
    """Return how many of the elites each operator made; what it offered is not told by the services."""
    codes, counts = np.unique(archive.operators[archive.filled], return_counts=True)
    return [
        {
            "operator": Operator(code).label,
            "offspring": None,
            "new_elites": None,
            "improved_elites": None,
            "elites": count,
        }
        for code, count in zip(codes.tolist(), counts.tolist(), strict=True)
    ]
