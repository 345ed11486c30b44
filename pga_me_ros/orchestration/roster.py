"""Which of a run's child processes have been heard, and when, according to their heartbeats."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterable

from pga_me_msgs.msg import NodeStatus

from pga_me_ros.orchestration.children import Children

STALE = 5.0
"""Seconds without a heartbeat after which a node counts as stale, and an evaluator's work is given to others."""

HANGING = 10.0
"""Seconds without a heartbeat after which a living child is reported: it may be suspended, and the run waits for it."""


class Roster:
    """Records the heartbeats of a run's child processes, and ignores all others.

    It does not have the evaluators of other machines. `EvaluatorPool` keeps those by name and process, as it decides
    who may have a name and who gets work.

    Args:
        children: The run's child processes.
        namespace: Namespace of the run.

    Attributes:
        arrivals: Number of child processes that have been heard so far.
    """

    def __init__(self, children: Children, namespace: str) -> None:
        self._children = children
        self._host = socket.gethostname()
        self._heard: dict[str, tuple[int, float]] = {}
        self._refused: dict[int, int] = {}
        self.prefix = namespace.rstrip("/") + "/"
        self.arrivals = 0

    def heard(self, msg: NodeStatus) -> bool:
        """Process a heartbeat.

        Returns:
            Whether it comes from one of the run's processes, even one that has been replaced since.
        """
        if msg.pid not in self._children.pids or msg.host != self._host:
            return False
        name = self.name_of(msg)
        pid = self._children.pid(name)
        if pid is not None:  # anybody can send any name
            self._refused[msg.pid] = msg.refused
            if pid == msg.pid:
                self.arrivals += not self._is_up(name)
                self._heard[name] = (msg.pid, time.monotonic())
            if msg.done:
                self._children.working(name, msg.pid)
        return True

    def name_of(self, msg: NodeStatus) -> str:
        """Return a node's name within the namespace of the run."""
        return msg.node.removeprefix(self.prefix)

    @property
    def all_up(self) -> bool:
        """Whether the present process of every child has been heard."""
        up, there = self.up
        return up == there

    @property
    def up(self) -> tuple[int, int]:
        """How many children have been heard, and how many there are."""
        there = self._children.names()
        return sum(self._is_up(name) for name in there), len(there)

    @property
    def refused(self) -> int:
        """Number of requests and messages that the run's children have refused, dead ones included."""
        return sum(self._refused.copy().values())

    def stale(self) -> dict[str, float]:
        """Return seconds of silence by name for children that were heard but are stale, restarted or not."""
        now = time.monotonic()
        silence = {name: now - since for name, (_, since) in self._heard.copy().items()}
        there = self._children.names()
        return {name: s for name, s in silence.items() if s > STALE and name in there}

    def hanging(self, names: Iterable[str]) -> set[str]:
        """Return which children have gone silent; a process that was never heard may still be starting."""
        now = time.monotonic()
        there = self._children.names()
        return {
            name
            for name in names
            if name in there and self._is_up(name) and now - self._heard[name][1] > HANGING
        }

    def _is_up(self, name: str) -> bool:
        pid, _ = self._heard.get(name, (0, 0.0))
        return pid == self._children.pid(name)
