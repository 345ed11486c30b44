"""How a run is going, for people: one calm line in a terminal, plain lines elsewhere, and a topic."""

from __future__ import annotations

import math
import os
import socket
import sys
import time
from collections import deque

from pga_me_msgs.msg import Metrics, Progress
from rclpy.node import Node

from pga_me_ros.core.settings import Settings
from pga_me_ros.ros import names, qos

WINDOW = 20
"""Generations over which the rate is taken."""


class ProgressReporter:
    """Publishes `Progress` and prints it.

    Args:
        node: The orchestrator's node.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.msg = Progress(
            state="starting", generation=-1, host=socket.gethostname(), pid=os.getpid()
        )
        self.msg.max_fitness = self.msg.eta = math.nan
        self._publisher = node.create_publisher(Progress, names.PROGRESS, qos.LATCHED)
        self._times: deque[tuple[float, int]] = deque(maxlen=WINDOW + 1)
        self._in_place = sys.stdout.isatty()
        self._open_line = False

    def begin(self, run_id: str, settings: Settings) -> None:
        """Say which run it is."""
        self.msg.run_id, self.msg.task = run_id, settings.task
        self.msg.generations = settings.generations
        self.msg.budget = settings.generations * settings.batch_size
        self.publish()

    def enter(self, state: str) -> None:
        """Say that the run is in another state now."""
        self.msg.state = state
        self.publish()

    def generation(self, metrics: Metrics, *, finished: bool = True) -> None:
        """Report the archive after a generation.

        Args:
            metrics: Its metrics.
            finished: Whether the generation was done just now, rather than before this start.
        """
        msg = self.msg
        msg.generation, msg.evaluations = metrics.generation, metrics.evaluations
        msg.cells, msg.coverage = metrics.cells, metrics.coverage
        msg.qd_score, msg.max_fitness = metrics.qd_score, metrics.max_fitness
        self._times.append((time.monotonic(), metrics.evaluations))
        (t0, n0), (t1, n1) = self._times[0], self._times[-1]
        if t1 > t0:
            msg.rate = (n1 - n0) / (t1 - t0)
            msg.eta = max(0, msg.budget - msg.evaluations) / msg.rate
        self.publish()
        if finished:
            self._print(self.line(), in_place=True)

    def publish(self) -> None:
        """Publish the present state."""
        self.msg.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(self.msg)

    def say(self, text: str) -> None:
        """Print a line of its own."""
        self._print(text, in_place=False)

    def line(self) -> str:
        """Return the progress in one line."""
        m = self.msg
        return (
            f"{m.task}  generation {m.generation + 1}/{m.generations}  "
            f"evaluations {m.evaluations}/{m.budget}  {m.rate:.1f}/s  "
            f"coverage {m.coverage}/{m.cells}  QD-score {m.qd_score:.0f}  best {m.max_fitness:.0f}  "
            f"ETA {_duration(m.eta)}"
        )

    def _print(self, text: str, *, in_place: bool) -> None:
        in_place = in_place and self._in_place
        start = "\r\x1b[K" if self._open_line else ""
        print(start + text, end="" if in_place else "\n", flush=True)
        self._open_line = in_place


def _duration(seconds: float) -> str:
    if math.isnan(seconds):
        return "?"
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
