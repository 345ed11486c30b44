"""Detection of other nodes of the same name, which ROS 2 allows but mixes up."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable

from pga_me_msgs.msg import NodeStatus
from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import NameValidationException
from rclpy.node import Node

from pga_me_ros.errors import PgaError
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.options import LISTEN
from pga_me_ros.ros.refusals import printable
from pga_me_ros.ros.spinning import EndingNode

STOP_OR_MOVE = "Stop that node, or give this one a namespace (--ros-args -r __ns:=/NAME) or another ROS_DOMAIN_ID."
"""What the user can do if another node of the same kind has the name."""

LISTEN_ON = 5.0
"""Seconds to listen if the graph has the name more than once: discovery is slow, or a namesake was killed recently."""

ELDER = 5.0
"""Seconds after the start in which a namesake counts as older. If two start at about the same time, both leave: no node
is better than two that answer in turn."""


def leave_to_elders(
    node: EndingNode, is_namesake: Callable[[NodeStatus], bool], advice: str
) -> None:
    """Make a node leave its name to an older namesake: it ends with a `PgaError` when it hears one.

    Args:
        node: The node, which was started just now.
        is_namesake: Whether a heartbeat from another process is that of a namesake.
        advice: What the user can do.
    """
    start = time.monotonic()
    ours = (socket.gethostname(), os.getpid())

    def make_way(msg: NodeStatus) -> None:
        was_there = time.monotonic() - start < ELDER
        if (msg.host, msg.pid) != ours and was_there and is_namesake(msg):
            who = printable(
                f"{msg.node} is taken in this ROS domain by process {msg.pid} on {msg.host}"
            )
            node.end(PgaError(f"The name {who}. {advice}"))

    node.create_subscription(NodeStatus, names.STATUS, make_way, qos.STATUS)


def listening_time(node: Node, *singletons: str, wait: float = LISTEN) -> float:
    """Return how long to listen for namesakes before names count as free, in seconds.

    A killed process stays in the graph for some 20 s, so a name in the graph is only a reason to listen longer.

    Args:
        node: Node that gives access to the graph.
        singletons: Names in its namespace that the graph should have once each.
        wait: How long to listen if no name is taken, s; 0 to listen in no case.
    """
    if not wait:
        return 0.0
    there = node.get_node_names_and_namespaces()
    taken = any(there.count((name, node.get_namespace())) > 1 for name in singletons)
    return max(wait, LISTEN_ON) if taken else wait


def offers_service(node: Node, name: str) -> bool:
    """Return whether a service exists; the name may come from anybody and need not be valid.

    Args:
        node: Node that gives access to the graph.
        name: Name of the service before remapping.
    """
    try:
        return node.count_services(node.resolve_service_name(name)) > 0
    except (ValueError, RuntimeError, RCLError, NameValidationException):
        return False
