"""Other nodes of the same name: ROS 2 lets them be, and mixes them up."""

from __future__ import annotations

from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import NameValidationException
from rclpy.node import Node

LISTEN = 4.0
"""Seconds in which a living namesake is heard. Mostly two nodes find each other at once, but every few times what one
says of itself comes too early for the other, and Fast DDS repeats it after up to 3 s. Then the next sign of life has to
come, one every second."""

LISTEN_ON = 5.0
"""Seconds to listen when the graph has the name more than once: discovery is slow, or a namesake was killed lately."""


def listening_time(node: Node, *names: str) -> float:
    """Return for how long to listen for namesakes before names count as free.

    A killed process stays in the graph for some 20 s, so being there is no proof of life, only a reason to listen on.

    Args:
        node: Node to look at the graph with.
        names: Names in its namespace of which the graph should have one each.
    """
    there = node.get_node_names_and_namespaces()
    taken = any(there.count((name, node.get_namespace())) > 1 for name in names)
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
