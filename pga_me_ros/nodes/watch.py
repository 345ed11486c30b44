"""The orchestrator's view of its team: what it tells in /diagnostics, and what it sums up at the end."""

from __future__ import annotations

import socket
import time

from diagnostic_msgs.msg import DiagnosticStatus
from pga_me_msgs.msg import NodeStatus, Progress

from pga_me_ros.nodes.children import Children
from pga_me_ros.nodes.control import Control
from pga_me_ros.nodes.evaluator_pool import EvaluatorPool
from pga_me_ros.ros.diagnostics import Diagnostics, silent

SILENCE = 5.0
"""Seconds without a sign of life after which a child that was there counts as stale."""


class Watch:
    """Listens to the signs of life of a run's children.

    Args:
        control: The orchestrator's node.
        children: The run's child processes.
        pool: Its evaluators.
        run_id: Id of the run.
    """

    def __init__(
        self, control: Control, children: Children, pool: EvaluatorPool, run_id: str
    ) -> None:
        self._children = children
        self._pool = pool
        self._diagnostics = Diagnostics(control)
        self._diagnostics.run_id = run_id
        self._prefix = control.get_namespace().rstrip("/") + "/"
        self._host = socket.gethostname()
        self._heard: dict[str, float] = {}
        self._refused: dict[int, int] = {}
        self._restarts = 0

    @property
    def refused(self) -> int:
        """Requests and messages that the run's children have refused, the dead ones' too."""
        return sum(self._refused.copy().values())

    def heard(self, msg: NodeStatus) -> None:
        """Take a node's sign of life."""
        name = msg.node.removeprefix(self._prefix)
        ours = msg.pid in self._children.pids and msg.host == self._host
        if ours and name in self._children.names():  # anybody can send one with any name
            self._refused[msg.pid] = msg.refused
            self._heard[name] = time.monotonic()

    def failed(self, reason: str) -> None:
        """Note why the run cannot go on."""
        self._diagnostics.fault(reason)

    def publish(self, progress: Progress) -> None:
        """Publish how the run is, and who is silent; to be called once a second."""
        if self._children.restarts > self._restarts:
            self._restarts = self._children.restarts
            self._diagnostics.disturbance("a node died and was started again")
        self._diagnostics.queue = self._pool.waiting
        more = {
            "state": progress.state,
            "generation": progress.generation,
            "evaluators": len(self._pool),
            "restarts": self._restarts,
            "re-evaluations": progress.reevaluations,
        }
        self._diagnostics.publish(progress.evaluations, self.refused, more, self._silent())

    def _silent(self) -> list[DiagnosticStatus]:
        """Return entries about children that were there and are not heard of any more."""
        now = time.monotonic()
        return [
            silent(self._prefix + name, self._diagnostics.run_id, now - since)
            for name, since in self._heard.copy().items()
            if now - since > SILENCE and name in self._children.names()
        ]
