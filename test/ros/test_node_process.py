"""`run_node` leaves nothing behind in the process that called it, and its process ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import weakref

import pytest
from domain_coordinator import domain_id

from pga_me_ros.errors import SettingsError
from pga_me_ros.process.parent_watch import PARENT_WATCH
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


STUCK = """
import ctypes, sys
from rclpy.node import Node
from pga_me_ros.process import dismantling, parent_watch
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.process import run_node
from pga_me_ros.ros.spinning import EndingNode

dismantling.LIMIT, parent_watch.GRACE = 0.5, 0.2
Node.destroy_node = lambda self: ctypes.PyDLL(None).sleep(3600)  # holds Python's lock, as rclpy does
parent_watch.watch_parent()

class Stuck(EndingNode):
    def __init__(self):
        super().__init__("stuck")
        self.create_timer(0.01, lambda: print("ready", flush=True))

sys.exit(run_node(Program("x", "", ()), Stuck, []))
"""


@pytest.mark.parametrize("cause", ["signal", "parent"])
def test_a_process_ends_though_ros_does_not_get_done_with_its_node(cause: str) -> None:
    with domain_id() as domain:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain), PARENT_WATCH: "1"}
        pipe = subprocess.PIPE
        process = subprocess.Popen(
            [sys.executable, "-c", STUCK],
            stdin=pipe,
            stdout=pipe,
            stderr=pipe,
            text=True,
            env=environment,
        )
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            assert process.stderr is not None
            assert process.stdout.readline() == "ready\n"
            if cause == "signal":
                process.send_signal(signal.SIGINT)
            else:
                process.stdin.close()
            assert process.wait(60.0) == 1
            assert "in destroy_node" in process.stderr.read()
        finally:
            process.kill()
            process.wait()
