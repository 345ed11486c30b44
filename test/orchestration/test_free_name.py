"""An orchestrator starts only if no other one has its name."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest
import rclpy
from domain_coordinator import domain_id
from pga_me_msgs.msg import Progress
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher

from pga_me_ros.errors import PgaError
from pga_me_ros.orchestration.calls import Waiter
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.free_name import name_on_this_machine, require_free_name
from pga_me_ros.orchestration.lead import spinning
from pga_me_ros.ros import names, qos

LONG = 60.0
"""Seconds that the orchestrator listens if it hears nobody, and that any other step may take."""

ELDER = Progress(pid=1, host="elsewhere", task="qd_ant")
"""A claim to the name that is older than any other."""


@pytest.fixture
def control(monkeypatch: pytest.MonkeyPatch) -> Iterator[Control]:
    """Return an orchestrator's node, in a domain of its own; it does not spin yet."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    arguments = ["--ros-args", "-p", "task:=qd_hopper", "-p", f"discovery_wait:={LONG}"]
    with domain_id() as domain:
        rclpy.init(args=arguments, domain_id=domain)
        control = Control()
        yield control
        control.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def other(control: Control) -> Iterator[Node]:
    """Return another node of that domain."""
    context = Context()
    rclpy.init(context=context, domain_id=control.context.get_domain_id())
    node = Node("other", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


def send(publisher: Publisher, claim: Progress) -> None:
    """Publish a claim, and wait until it has arrived at its subscriber, which need not spin."""
    found = Waiter(lambda: None).until(lambda: publisher.get_subscription_count() > 0, LONG)
    assert found
    publisher.publish(claim)
    assert publisher.wait_for_all_acked(Duration(seconds=LONG))


def test_a_busy_orchestrator_hears_an_older_claim_although_its_own_comes_next(
    control: Control, other: Node
) -> None:
    claim = Progress(pid=os.getpid(), host=socket.gethostname())
    claim.stamp = control.get_clock().now().to_msg()
    with ThreadPoolExecutor(1) as pool:
        listening = pool.submit(require_free_name, control, claim, new=False)
        send(other.create_publisher(Progress, names.PROGRESS, qos.LATCHED), ELDER)
        send(control.create_publisher(Progress, names.PROGRESS, qos.LATCHED), claim)
        with (
            spinning(control),
            pytest.raises(PgaError, match=r"runs as /orchestrator \(process 1 on elsewhere, task"),
        ):
            listening.result()


def test_the_name_on_this_machine_is_held_by_one_per_discovery_server(
    control: Control, monkeypatch: pytest.MonkeyPatch
) -> None:
    us = rf"Another orchestrator runs as /orchestrator \(process {os.getpid()} on"
    with name_on_this_machine(control):
        with pytest.raises(PgaError, match=us):
            name_on_this_machine(control)
        monkeypatch.setenv("ROS_DISCOVERY_SERVER", "192.0.2.1:11811")
        name_on_this_machine(control).release()
