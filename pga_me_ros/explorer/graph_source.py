"""A running graph as the page shows it, by the services and topics that any robot's node may use."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.client import RepertoireClient, RepertoireInfo
from pga_me_ros.core.operators import OPERATORS, Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import PgaError, RequestError
from pga_me_ros.explorer.description import describe_cells, describe_elites, describe_spec
from pga_me_ros.explorer.history import History
from pga_me_ros.explorer.run_watch import RunWatch
from pga_me_ros.explorer.served_archive import served_archive, spec_of
from pga_me_ros.explorer.source import FORMATS, require_shown
from pga_me_ros.explorer.steering import ACTIONS, Steering
from pga_me_ros.player.gait import Gait
from pga_me_ros.query.saving import require_savable, save
from pga_me_ros.ros.command_line import Program, start
from pga_me_ros.ros.node_names import require_valid_namespace
from pga_me_ros.ros.spinning import EndingNode

PROGRAM = Program("explorer", "Shows a repertoire in the browser.", ())

SILENT_AFTER = 5.0
"""Seconds without word from the orchestrator after which the page says so; it speaks once a second."""

PAUSE = 250.0
"""After behaviors were fetched, none are fetched for this many times as long: the archive manager has other work, and a
browser on a machine without a graphics card takes some tenths of a core second to draw the map again."""


def open_graphs(namespaces: Sequence[str], ros_args: Sequence[str]) -> list[GraphSource]:
    """Return what the graphs of some namespaces serve.

    Args:
        namespaces: Namespaces, each with a run or an archive manager; empty for the one of the ROS arguments.
        ros_args: ``--ros-args`` and what follows.

    Raises:
        SettingsError: A namespace or an argument is invalid.
        RepertoireTimeoutError: Nobody serves a repertoire there.
        PgaError: It holds no behavior yet.
    """
    for namespace in namespaces:
        require_valid_namespace(namespace, "--graph ")
    if len(set(namespaces)) < len(namespaces):
        raise RequestError("--graph names a namespace twice; give each once.")
    start(PROGRAM, list(ros_args), signal_handler_options=SignalHandlerOptions.NO)
    opened: list[GraphSource] = []
    try:
        for namespace in namespaces or [""]:
            opened.append(GraphSource(namespace))
    except BaseException:
        for source in opened:
            source.close()
        rclpy.try_shutdown()
        raise
    return opened


class GraphSource:
    """The repertoire that a graph serves.

    Args:
        namespace: Its namespace, empty for the one of the ROS arguments. ROS 2 is initialized.

    Raises:
        RepertoireTimeoutError: Nobody serves one.
        RequestError: The ROS arguments name another namespace.
        PgaError: It holds no behavior yet.
    """

    def __init__(self, namespace: str) -> None:
        self._node = EndingNode(PROGRAM.name, namespace=namespace or None)
        self._client = RepertoireClient(self._node)
        self._watch = RunWatch(self._node)
        self._history = History()
        self.version = 0
        self.problem = ""
        self._spinning = threading.Thread(target=self._spin, daemon=True)
        self._spinning.start()
        try:
            self._require_namespace(namespace)
            info = self._first_generation()
            self._run_id = info.run_id
            self.settings = Settings.from_stored(info.settings)
            self._steering = Steering(self._node, self.settings)
            self._spec, self._unlike = spec_of(info, self.settings)
            self.content: dict[str, Any] = {}
            self._shown = (info.generation, info.corrected_repeats)
            self._read()
            self._next_read = 0.0  # the first one also computed the cells of the archive
        except BaseException:
            self.close()
            raise

    def refresh(self) -> None:
        """See `Source`; behaviors are fetched when a generation or re-evaluations have come in."""
        try:
            info = self._client.get_info()
            self.problem = self._trouble(info)
            now = (info.generation, info.corrected_repeats)
            due = time.monotonic() >= self._next_read or not info.growing
            if now != self._shown and due and info.run_id == self._run_id:
                self._read()
                self._shown = now
        except PgaError as error:
            self.problem = f"The graph does not answer: {error} The page shows its last state."

    def state(self) -> dict[str, Any] | None:
        """See `Source`."""
        return {
            **self._watch.state(),
            "rates": self._steering.rates,
            "actions": list(ACTIONS),
        }

    def gait(self, cell: int) -> Gait:
        """See `Source`."""
        return self._client.get_behavior(cell=cell)

    def download(self, cell: int, evaluation: int, kind: str) -> bytes:
        """See `Source`."""
        behavior = self._client.get_behavior(cell=cell)
        require_shown(behavior, evaluation)
        with TemporaryDirectory() as folder:
            out = Path(folder) / f"gait{FORMATS[kind]}"
            require_savable(out)
            save(behavior, self._client.get_info(), out)
            return out.read_bytes()

    def control(self, action: str, values: dict[str, Any]) -> str:
        """See `Source`."""
        return self._steering.carry_out(action, values)

    def close(self) -> None:
        """See `Source`."""
        rclpy.try_shutdown()
        self._spinning.join(5.0)
        self._node.destroy_node()

    def _require_namespace(self, namespace: str) -> None:
        """Make sure that no remapping has put the node elsewhere."""
        found = self._node.get_namespace()
        if namespace and found != namespace:
            raise RequestError(
                f"--graph says {namespace}, but the ROS arguments put the node into {found}; give only one."
            )

    def _trouble(self, info: RepertoireInfo) -> str:
        """Return what is wrong with the graph, in words for the page."""
        if info.run_id != self._run_id:
            return "The graph serves another run now; restart the explorer to see it. The page shows the one before."
        if info.growing and self._watch.silent > SILENT_AFTER:
            return f"No message from the run for {self._watch.silent:.0f} s; the page shows its last state."
        return ""

    def _first_generation(self) -> RepertoireInfo:
        """Return what the repertoire is, once it holds a behavior or no run adds to it."""
        info = self._client.get_info()
        if info.growing and not info.coverage:
            print("waiting for the first generation of the run", file=sys.stderr)
        while info.growing and not info.coverage:
            time.sleep(0.5)
            info = self._client.get_info()
        return info

    def _read(self) -> None:
        """Fetch all behaviors, and describe them.

        Raises:
            RequestError: There is none yet.
        """
        began = time.monotonic()
        info = self._client.get_info()
        behaviors = list(self._client.list_behaviors(page=10_000)) if info.coverage else []
        if not behaviors:
            raise RequestError(
                "The repertoire that is served holds no behavior; serve another, or run its run for longer."
            )
        self._history.extend(self._client.list_generations(self._history.first_wanted))
        archive, known, note = served_archive(info, self._spec, self.settings, behaviors)
        namespace = self._node.get_namespace()
        self.content = {
            "run": {
                "name": info.task if namespace == "/" else f"{info.task} of {namespace}",
                "namespace": namespace,
                "task": info.task,
                "algorithm": self.settings.algorithm,
                "seed": self.settings.seed,
                "run_id": info.run_id,
                "note": "; ".join(filter(None, (self._unlike, note))),
            },
            "spec": describe_spec(self._spec),
            "archive": describe_cells(archive),
            "elites": describe_elites(archive, known),
            "operators": {operator.label: OPERATORS[operator].title for operator in Operator},
            **self._history.described(),
            "served": True,
        }
        self.version += 1
        self._next_read = time.monotonic() + PAUSE * (time.monotonic() - began)

    def _spin(self) -> None:
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        try:
            while rclpy.ok():
                executor.spin_once(timeout_sec=0.5)
        except ExternalShutdownException:
            pass
        finally:
            executor.shutdown()
