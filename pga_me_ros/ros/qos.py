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
"""An evaluator's side of experience/transitions. Bounded: a subscriber that hangs costs 200 episodes of memory."""

EXPERIENCE_READER = _reliable(2000)
"""The trainer's side: one reader's depth is shared by all evaluators, and a generation must fit into it."""

LATCHED = _reliable(1, latched=True)
"""Newest state for whoever comes, however late: critic snapshots, metrics, heatmap, progress."""

ELITES = _reliable(10)
"""One message per generation, and one per request to publish parents again: a listener makes offspring meanwhile."""

STATUS = _reliable(50)
"""Heartbeats of the nodes."""

DIAGNOSTICS = _reliable(1)
"""As diagnostic_updater publishes."""

CLIENT = _reliable(1000)
"""A client's side of a service. Its reader hears the answers to all clients, and keeps the newest until the node is
spun: with rclpy's depth of 10, whoever is busy while others ask ten times never hears the answer to itself."""

ASKED_BY_MANY = _reliable(100)
"""A server's side of what any number of robots may ask at the same time; with rclpy's 10, the eleventh to ask while the
node is busy puts the first out of the queue. Services that only the run uses keep rclpy's: their messages are large."""

STREAM = _reliable(100)
"""A robot in motion: one message per control step."""
