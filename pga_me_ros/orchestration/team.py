"""The nodes of one run: their parameters, their start, and whether all are alive."""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

from pga_me_msgs.msg import NodeStatus

from pga_me_ros.core.runs.critic_checkpoints import CriticCheckpoints
from pga_me_ros.core.runs.run_directory import RunDirectory
from pga_me_ros.core.storage.database import explained
from pga_me_ros.core.storage.files import replace_file
from pga_me_ros.errors import PgaError
from pga_me_ros.orchestration.children import Children, parameters_file
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.evaluator_pool import EvaluatorPool
from pga_me_ros.orchestration.roster import HANGING, Roster
from pga_me_ros.process.prepared_child import PreparedChild
from pga_me_ros.ros.command_line import remappings
from pga_me_ros.ros.namesakes import listening_time
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.refusals import printable

SINGLETONS = ("archive_manager", "critic_trainer", "variation")
"""Nodes that a run has once each; their kind is their name."""


class Team:
    """Starts the nodes of a run and keeps them alive.

    Args:
        node: The orchestrator's node.
        directory: Folder of the run.
        pool: Evaluators; it is told when a child among them dies.
        prepared: Processes that were started early (`EarlyStart`), by node name.

    Attributes:
        children: Their processes.
        roster: Which of them have been heard from.
    """

    def __init__(
        self,
        node: Control,
        directory: RunDirectory,
        pool: EvaluatorPool,
        prepared: dict[str, PreparedChild],
    ) -> None:
        self._node = node
        self._directory = directory
        self._pool = pool
        lock = directory.lock.fileno()
        self.children = Children(directory.path, ros_arguments(node), lock, prepared)
        self.roster = Roster(self.children, node.get_namespace())
        self._silent: set[str] = set()
        self._foreign: NodeStatus | None = None

    def start_archive(self, *, grow: bool) -> None:
        """Start the node that serves the repertoire."""
        self._start(
            "archive_manager",
            "archive_manager",
            {
                "repertoire": str(self._directory.repertoire.resolve()),
                "grow": grow,
                "write_events": grow and self._node.options.tensorboard,
            },
        )

    def start_learners(self) -> None:
        """Start critic trainer and variation; trainings of an interrupted generation are repeated.

        Raises:
            StorageError: The stored outcome of a training is damaged.
        """
        CriticCheckpoints(self._directory.path).discard_since(self._directory.next_generation)
        values = {
            **self._directory.settings.given,
            "run_id": self._directory.run_id,
            "run_dir": str(self._directory.path.resolve()),
        }
        self._start("critic_trainer", "critic_trainer", values)
        self._start("variation", "variation", values)

    def start_evaluators(self) -> None:
        """Start evaluators on this machine."""
        for name in evaluator_names(self._node.options):
            self._start("evaluator", name, {"task": self._directory.settings.task})

    def stop_learners(self) -> None:
        """Stop what only a growing run needs: all but the archive manager and the evaluators."""
        learners = ("critic_trainer", "variation")
        self.children.stop([n for n in self.children.names() if n in learners])

    def stop_workers(self) -> None:
        """Stop all but the archive manager."""
        self.children.stop([n for n in self.children.names() if n != "archive_manager"])

    def heard(self, msg: NodeStatus) -> None:
        """Process a node's heartbeat."""
        if self.roster.heard(msg):
            return
        if msg.kind in SINGLETONS or self.roster.name_of(msg) in self.children.names():
            self._foreign = msg

    def ready(self) -> bool:
        """Whether every child has come up.

        Raises:
            PgaError: Another node has the name of one of the children.
        """
        if self._foreign:
            raise name_is_taken(self._foreign)
        if not self.roster.all_up:
            return False
        wait = self._node.options.discovery_wait
        listened = time.monotonic() - self._node.began
        return listened >= listening_time(self._node, *SINGLETONS, wait=wait)

    def tick(self) -> None:
        """Restart children that died and report those that have gone silent.

        Raises:
            ChildError: A child cannot be started, or dies repeatedly.
        """
        for name in self.children.revive():
            self._node.get_logger().warning(f"{name} died and was restarted")
            self._pool.died(self.roster.prefix + name)
        self._tell_of_silence()

    def _tell_of_silence(self) -> None:
        """Report which nodes that the run needs are silent, and when they are back."""
        silent = self.roster.hanging(SINGLETONS)
        for name in sorted(silent - self._silent):
            self._node.get_logger().warning(
                f"{name} (process {self.children.pid(name)}) has been silent for {HANGING:.0f} s and the run waits for "
                "it: if it is suspended, continue it (SIGCONT); if it hangs, kill it, and the run restarts it"
            )
        for name in sorted(self._silent - silent):
            self._node.get_logger().info(f"{name} is back")
        self._silent = silent

    def _start(self, kind: str, name: str, values: dict[str, Any]) -> None:
        path = parameters_file(self._directory.path, kind)
        # JSON is also YAML, and every number is read back exactly.
        content = json.dumps({"/**": {"ros__parameters": values}}, indent=2)
        with explained(self._directory.path):
            path.parent.mkdir(exist_ok=True)
            replace_file(path, f"{content}\n".encode())
            self.children.start(kind, name)


def evaluator_names(options: RunOptions) -> list[str]:
    """Return the names of the evaluators that a run starts on this machine."""
    return [f"evaluator_{i}" for i in range(options.evaluators or os.cpu_count() or 1)]


def ros_arguments(node: Control) -> list[str]:
    """Return the ROS arguments that each node of a run gets: the orchestrator's namespace and remappings."""
    return ["-r", f"__ns:={node.get_namespace()}", *remappings(sys.argv[1:])]


def name_is_taken(by: NodeStatus) -> PgaError:
    """Return the error for a run one of whose nodes has a namesake in the graph."""
    who = printable(f"{by.node} (process {by.pid} on {by.host})")
    return PgaError(
        f"The name {who} is taken in this ROS domain. Stop that node, or give this "
        "run a namespace (--ros-args -r __ns:=/NAME) or another ROS_DOMAIN_ID."
    )
