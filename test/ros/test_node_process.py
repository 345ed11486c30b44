"""`run_node` leaves nothing behind in the process that called it."""

from __future__ import annotations

import weakref

import pytest
from domain_coordinator import domain_id

from pga_me_ros.errors import SettingsError
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.process import run_node
from pga_me_ros.ros.spinning import EndingNode


def test_a_node_that_cannot_be_made_leaves_the_ros_graph(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    made: list[weakref.ref[EndingNode]] = []

    class HalfMade(EndingNode):
        """A node that refuses its parameters when others can see it already."""

        def __init__(self) -> None:
            super().__init__("half_made")
            made.append(weakref.ref(self))
            self.create_timer(60.0, self.tick)  # refers to the node, which refers to it
            raise SettingsError("seed is wrong")

        def tick(self) -> None:
            """Do nothing."""

    with domain_id() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        assert run_node(Program("x", "", ()), HalfMade, []) == 2
    assert capfd.readouterr().err == "error: seed is wrong\n"
    assert [node() for node in made] == [None]
