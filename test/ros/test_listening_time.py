"""How long a node listens for others of its name."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context
from rclpy.node import Node

from pga_me_ros.ros.namesakes import LISTEN, LISTEN_ON, listening_time


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Iterator[Node]:
    """Return one of two nodes of the name ``twin`` in one namespace."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = Context()
    with domain_id() as domain:
        rclpy.init(context=context, domain_id=domain)
        nodes = [Node("twin", context=context) for _ in range(2)]
        yield nodes[0]
        for node in nodes:
            node.destroy_node()
        context.try_shutdown()


def test_a_name_that_the_graph_has_twice_takes_longer(node: Node) -> None:
    assert listening_time(node, "nobody") == LISTEN
    assert listening_time(node, "nobody", "twin") == LISTEN_ON > LISTEN


def test_the_user_may_choose_longer_shorter_or_not_at_all(node: Node) -> None:
    assert listening_time(node, "nobody", wait=1.0) == 1.0
    assert listening_time(node, "twin", wait=1.0) == LISTEN_ON
    assert listening_time(node, "twin", wait=60.0) == 60.0
    assert listening_time(node, "twin", wait=0.0) == 0.0
