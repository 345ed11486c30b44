"""Other nodes of the same name: ROS 2 lets them be, and mixes them up."""

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
from pga_me_ros.ros.refusals import printable
from pga_me_ros.ros.spinning import EndingNode

LISTEN = 4.0
"""Seconds in which a living namesake is heard. Mostly two nodes find each other at once, but every few times what one
says of itself comes too early for the other, and Fast DDS repeats it after up to 3 s. Then the next heartbeat has to
come, one every second."""

LISTEN_ON = 5.0
"""Seconds to listen when the graph has the name more than once: discovery is slow, or a namesake was killed lately."""

ELDER = 5.0
"""Seconds after the start: a namesake that is heard within them was there before, or started at about the same time;
then both leave, as better none answers than two in turn."""


def leave_to_elders(
    node: EndingNode, is_namesake: Callable[[NodeStatus], bool], advice: str
) -> None:
    """Have a node leave its name to one that was there before: it ends with a `PgaError` once it hears of it.

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


def listening_time(node: Node, *singletons: str) -> float:
    """Return for how long to listen for namesakes before names count as free.

    A killed process stays in the graph for some 20 s, so being there is no proof of life, only a reason to listen on.

    Args:
        node: Node to look at the graph with.
        singletons: Names in its namespace of which the graph should have one each.
    """
    there = node.get_node_names_and_namespaces()
    taken = any(there.count((name, node.get_namespace())) > 1 for name in singletons)
    return LISTEN_ON if taken else LISTEN


def offers_service(node: Node, name: str) -> bool:
    """Return whether a service is there; anybody may tell a name, even one that can be none.

    Args:
        node: Node to look at the graph with.
        name: Name of the service before remapping.
    """
    try:
        return node.count_services(node.resolve_service_name(name)) > 0
    except (ValueError, RuntimeError, RCLError, NameValidationException):
        return False
