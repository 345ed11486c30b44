"""Quality of service of every topic and service of the graph, by name."""

from __future__ import annotations

from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSProfile,
    ReliabilityPolicy,
)


def _reliable(depth: int, *, latched: bool = False) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


EXPERIENCE_WRITER = _reliable(200)
"""Publisher of experience/transitions. Bounded: a subscriber that hangs costs 200 episodes of memory."""

EXPERIENCE_READER = _reliable(2000)
"""Subscriber in the trainer: all evaluators share one reader's depth, which must hold a generation."""

LATCHED = _reliable(1, latched=True)
"""Newest state for subscribers that join late: critic snapshots, metrics, heatmap, progress."""

CLAIMS = _reliable(100, latched=True)
"""Subscriber to the progress of everybody, its own included: all share one reader's depth, and a busy process takes
them late. With a depth of 1, its own claim to a name displaces an older one that came just before."""

ELITES = _reliable(10)
"""One message per generation, and one per request to publish parents again; the subscriber may be making offspring."""

STATUS = _reliable(50)
"""Heartbeats of the nodes."""

DIAGNOSTICS = _reliable(1)
"""As used by diagnostic_updater."""

CLIENT = _reliable(1000)
"""A client of a service. Its reader gets the answers to all clients, and keeps the newest until the node is spun: with
rclpy's depth of 10, a client that is busy while others make ten requests loses its own answer."""

ASKED_BY_MANY = _reliable(100)
"""A service that any number of robots may call at the same time; with rclpy's depth of 10, the eleventh request to a
busy node displaces the first. Services that only the run uses keep rclpy's depth, because their messages are large."""

STREAM = _reliable(100)
"""A moving robot: one message per control step."""

COMMANDS = _reliable(1)
"""Commands for joints: only the newest counts."""

SENSORS = QoSProfile(
    depth=10, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT
)
"""Readings of a robot's sensors: hears publishers of both kinds, reliable or not."""
