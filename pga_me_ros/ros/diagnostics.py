"""/diagnostics: the health of each node, for rqt_robot_monitor, diagnostic_aggregator or `ros2 topic echo`."""

from __future__ import annotations

import os
import socket
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from pga_me_ros.ros import names, qos

RATE_WINDOW = 10
"""Heartbeats over which the rate of work is averaged."""

MEMORY_PERIOD = 10
"""Heartbeats between two readings of the proportional memory, for which the kernel has to walk all pages."""

RECENT = 10.0
"""Seconds for which a fault or disturbance shows in the level."""

MIB = 1024.0
"""KiB per MiB."""


class Diagnostics:
    """A node's own entry in /diagnostics.

    The level is ERROR for a while after a fault, WARN for a while after a refusal or another disturbance that the node
    can handle, else OK. STALE is set by nodes that watch others: see `silent`.

    Args:
        node: The node.

    Attributes:
        run_id: Id of the run that the node works for, shown as hardware_id; empty before the first request.
        queue: Number of pieces of work that wait.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, qos.DIAGNOSTICS)
        self.run_id = ""
        self.queue = 0
        self._trouble = ""
        self._troubled = {DiagnosticStatus.ERROR: -RECENT, DiagnosticStatus.WARN: -RECENT}
        self._last_error = ""
        self._work: deque[tuple[float, int]] = deque(maxlen=RATE_WINDOW + 1)
        self._memory = Memory()

    def fault(self, reason: str) -> None:
        """Note something that should never happen."""
        self._note(DiagnosticStatus.ERROR, reason)

    def disturbance(self, reason: str) -> None:
        """Note something that the node can handle, such as a refusal."""
        self._note(DiagnosticStatus.WARN, reason)

    def publish(
        self,
        done: int,
        refused: int,
        more: Mapping[str, object] | None = None,
        others: Sequence[DiagnosticStatus] = (),
    ) -> None:
        """Publish the node's health; to be called once a second.

        Args:
            done: Number of pieces of work done so far.
            refused: Number of requests and messages refused so far.
            more: Further values.
            others: Entries about other nodes.
        """
        self._work.append((time.monotonic(), done))
        values: dict[str, object] = {
            "rate (1/s)": f"{self._rate():.3g}",
            "done": done,
            "queue": self.queue,
            "refused": refused,
            "last error": self._last_error,
            **(more or {}),
            **self._memory.values(),
            "host": socket.gethostname(),
            "pid": os.getpid(),
        }
        level = self._level()
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message="OK" if level == DiagnosticStatus.OK else self._trouble,
            hardware_id=self.run_id,
        )
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        msg = DiagnosticArray()
        msg.header.stamp = self._node.get_clock().now().to_msg()
        msg.status = [status, *others]
        self._publisher.publish(msg)

    def _note(self, level: bytes, reason: str) -> None:
        self._last_error = reason
        if level == DiagnosticStatus.ERROR or self._level() != DiagnosticStatus.ERROR:
            self._trouble = reason
        self._troubled[level] = time.monotonic()

    def _level(self) -> bytes:
        now = time.monotonic()
        recent = [level for level, since in self._troubled.items() if now - since < RECENT]
        return max(recent, default=DiagnosticStatus.OK)

    def _rate(self) -> float:
        (t0, n0), (t1, n1) = self._work[0], self._work[-1]
        return (n1 - n0) / (t1 - t0) if t1 > t0 else 0.0


def silent(name: str, run_id: str, seconds: float) -> DiagnosticStatus:
    """Return an entry about a node that should be there but has gone silent.

    Args:
        name: Full name of the node.
        run_id: Id of its run.
        seconds: Time since its last heartbeat.
    """
    return DiagnosticStatus(
        level=DiagnosticStatus.STALE,
        name=name,
        message=f"no heartbeat for {seconds:.0f} s",
        hardware_id=run_id,
    )


class Memory:
    """Memory of this process as reported by Linux."""

    def __init__(self) -> None:
        self._beats = 0
        self._shared = ""

    def values(self) -> dict[str, str]:
        """Return resident memory (RSS) and proportional memory (PSS), the latter measured only now and then.

        PSS divides what several processes share, such as libraries, among them.
        """
        if self._beats % MEMORY_PERIOD == 0:
            self._shared = _kib("/proc/self/smaps_rollup", "Pss:")
        self._beats += 1
        found = {"memory RSS (MiB)": _kib("/proc/self/status", "VmRSS:")}
        return {
            name: kib for name, kib in {**found, "memory PSS (MiB)": self._shared}.items() if kib
        }


def _kib(path: str, field: str) -> str:
    """Return a number of KiB in a file of /proc as MiB, empty if there is none."""
    try:
        lines = Path(path).read_text().splitlines()
    except OSError:
        return ""
    found = next((line.split()[1] for line in lines if line.startswith(field)), "")
    return f"{int(found) / MIB:.1f}" if found else ""
