"""The nodes of one run: which there are, with which parameters, and whether all are alive."""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from pathlib import Path
from typing import Any

from pga_me_msgs.msg import NodeStatus

from pga_me_ros.core.critic_checkpoint import CriticCheckpoints
from pga_me_ros.core.errors import PgaError
from pga_me_ros.core.run_directory import RunDirectory
from pga_me_ros.core.storage_file import explained
from pga_me_ros.nodes.children import Children
from pga_me_ros.nodes.control import Control
from pga_me_ros.nodes.evaluator_pool import EvaluatorPool
from pga_me_ros.ros.command_line import remappings
from pga_me_ros.ros.namesakes import listening_time
from pga_me_ros.ros.refusals import printable

SINGLETONS = ("archive_manager", "critic_trainer", "variation")
"""Nodes of which a run has one each; their kind is their name."""

SILENCE = 10.0
"""Seconds without a sign of life after which a living child is told of: it may be stopped, and the run waits for it."""


class Team:
    """Starts the nodes of a run and keeps them alive.

    Args:
        node: The orchestrator's node.
        directory: Folder of the run.
        pool: Evaluators, told when one of ours died.

    Attributes:
        arrivals: How often a child has said for the first time that it is up.
    """

    def __init__(self, node: Control, directory: RunDirectory, pool: EvaluatorPool) -> None:
        self._node = node
        self._directory = directory
        self._pool = pool
        namespace = node.get_namespace()
        self._prefix = namespace.rstrip("/") + "/"
        arguments = ["-r", f"__ns:={namespace}", *remappings(sys.argv[1:])]
        self.children = Children(directory.path, arguments, directory.lock.fileno())
        self._parameters = directory.path / "parameters"
        self._parameters.mkdir(exist_ok=True)
        self._alive: set[tuple[str, int]] = set()
        self._seen: dict[str, float] = {}
        self._silent: set[str] = set()
        self._foreign: NodeStatus | None = None
        self.arrivals = 0

    def start_archive(self, *, grow: bool) -> None:
        """Start the node that serves the repertoire."""
        self._start(
            "archive_manager",
            "archive_manager",
            {"repertoire": str(self._directory.repertoire.resolve()), "grow": grow},
        )

    def start_learners(self) -> None:
        """Start critic trainer and variation; what an interrupted generation trained is trained again.

        Raises:
            StorageError: A stored outcome of a training is damaged.
        """
        CriticCheckpoints(self._directory.path).discard_since(self._directory.next_generation)
        values = {
            **self._directory.settings.to_dict(),
            "run_id": self._directory.run_id,
            "run_dir": str(self._directory.path.resolve()),
        }
        self._start("critic_trainer", "critic_trainer", values)
        self._start("variation", "variation", values)

    def start_evaluators(self, count: int) -> None:
        """Start evaluators on this machine."""
        for i in range(count):
            self._start("evaluator", f"evaluator_{i}", {"task": self._directory.settings.task})

    def stop_workers(self) -> None:
        """Stop all but the archive manager."""
        self.children.stop([n for n in self.children.names() if n != "archive_manager"])

    def heard(self, msg: NodeStatus) -> None:
        """Take a node's sign of life."""
        name = msg.node.removeprefix(self._prefix)
        if msg.pid in self.children.pids and msg.host == socket.gethostname():
            ours = name in self.children.names() and self.children.pid(name) == msg.pid
            if ours and (name, msg.pid) not in self._alive:
                self._alive.add((name, msg.pid))
                self.arrivals += 1
            if ours:
                self._seen[name] = time.monotonic()
            if msg.done:
                self.children.working(name, msg.pid)
        elif msg.kind in SINGLETONS or name in self.children.names():
            self._foreign = msg

    def ready(self) -> bool:
        """Whether every child has said that it is up, and nobody else has the names of ours.

        Raises:
            PgaError: Somebody else's node has the name of one of ours.
        """
        if self._foreign:
            raise name_is_taken(self._foreign)
        children = self.children
        if any((name, children.pid(name)) not in self._alive for name in children.names()):
            return False
        return time.monotonic() - self._node.began >= listening_time(self._node, *SINGLETONS)

    def tick(self) -> None:
        """Restart what has died, and tell of what has fallen silent.

        Raises:
            ChildError: A child cannot be started, or dies again and again.
        """
        for name in self.children.revive():
            self._node.get_logger().warning(f"{name} died; it was started again")
            self._pool.died(self._prefix + name)
            self._seen.pop(name, None)
        self._tell_of_silence()

    def _tell_of_silence(self) -> None:
        """Say which of the nodes that the run cannot do without are silent, and when they are back."""
        now = time.monotonic()
        silent = {
            name
            for name in self.children.names()
            if name in SINGLETONS and now - self._seen.get(name, now) > SILENCE
        }
        for name in sorted(silent - self._silent):
            self._node.get_logger().warning(
                f"{name} (process {self.children.pid(name)}) has been silent for {SILENCE:.0f} s and the run waits for "
                "it: if it is stopped, let it go on (SIGCONT); if it hangs, kill it, and it is started again"
            )
        for name in sorted(self._silent - silent):
            self._node.get_logger().info(f"{name} is back")
        self._silent = silent

    def _start(self, kind: str, name: str, values: dict[str, Any]) -> None:
        path = self._parameters / f"{kind}.yaml"
        # JSON is YAML too, and writes every number so that it is read back the same.
        content = json.dumps({"/**": {"ros__parameters": values}}, indent=2)
        temporary = Path(f"{path}.new")
        with explained(self._directory.path):
            temporary.write_text(content + "\n")
            os.replace(temporary, path)
            self.children.start(kind, name, path)


def name_is_taken(by: NodeStatus) -> PgaError:
    """Return the error of a run of which a node has its namesake in the graph."""
    who = printable(f"{by.node} (process {by.pid} on {by.host})")
    return PgaError(
        f"The name {who} is taken in this ROS domain. Stop that node, or give this "
        "run a namespace (--ros-args -r __ns:=/NAME) or another ROS_DOMAIN_ID."
    )
