"""Evaluator: one simulated world that turns controllers into fitness, descriptor and experience."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # one thread per episode: several evaluators use the cores, not BLAS

import numpy as np
import rclpy
from pga_me_msgs.msg import Transitions
from pga_me_msgs.srv import Evaluate
from rclpy.executors import ExternalShutdownException

from pga_me_ros.core.evaluation import evaluation_rng, reevaluation_rng
from pga_me_ros.core.exploration import Noise, exploring
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.field import checked_value, setting
from pga_me_ros.errors import RequestError
from pga_me_ros.process.ending import leave
from pga_me_ros.process.parent_watch import PARENT_WATCH
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.convert import episode_to_msg, finite, flat, layers_from_msg, shaped
from pga_me_ros.ros.dds_choices import LOCAL_NOTE, is_local
from pga_me_ros.ros.evaluations import aims_from_msg
from pga_me_ros.ros.graph_node import GraphNode, own_name
from pga_me_ros.ros.namesakes import leave_to_elders, listening_time
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameters import declare
from pga_me_ros.ros.process import run_node
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import make_task, simulation_versions
from pga_me_ros.tasks.rollout import Episode, rollout

READER_WAIT = 2.0
"""Seconds that a chunk waits for a subscriber of its experience; the trainer may not have been discovered yet."""

HELD = 0.1
"""Seconds that an episode may be held back, to be published with the next ones: ten short ones at once cost a
subscriber half as much as one after the other."""

OTHER_NAME = "Give this evaluator another one (--ros-args -r __node:=NAME), or none: it then makes up its own."
"""What the user can do if another evaluator has the name."""

NOISE = [f for f in fields(Settings) if f.name in ("exploration_sigma", "exploration_correlation")]
"""The settings with the ranges of the noise."""


@dataclass(frozen=True)
class EvaluatorSettings:
    """Parameters of an evaluator; everything else comes with each request, so it serves any run of its task."""

    task: str = setting("qd_walker", "Simulated robot: a built-in task, or module.path:ClassName.")


class Evaluator(GraphNode):
    """Simulates controllers on request, and publishes their experience."""

    def __init__(self) -> None:
        super().__init__("evaluator", own_name("evaluator"))
        self._task_name = declare(self, EvaluatorSettings, shared=(Settings, RunOptions))["task"]
        if _named_by_hand(self):
            self._require_free_name()
        self._tasks = {"": make_task(self._task_name)}
        self._spec = self._tasks[""].spec
        self._experience = self.create_publisher(
            Transitions, names.TRANSITIONS, qos.EXPERIENCE_WRITER
        )
        self._patience = READER_WAIT
        self.serve(Evaluate, names.EVALUATE, self._evaluate)
        self.start_heartbeat(task=self._task_name, versions=simulation_versions(self._task_name))
        if is_local() and os.environ.get(PARENT_WATCH) != "1":
            self.get_logger().info(LOCAL_NOTE)

    def _evaluate(self, request: Evaluate.Request, response: Evaluate.Response) -> None:
        controllers = self._controllers(request)
        task = self._randomized(request.randomization)
        if request.repeats:
            self._answer(response, self._again(task, request, controllers))
            return
        n = len(controllers)
        aims = aims_from_msg(request.intended_descriptors, n, self._spec.descriptor_dim)
        episodes: list[Episode] = []
        published = 0
        self._wait_for_reader()
        self.diagnostics.run_id = request.run_id
        self.diagnostics.queue = n
        noise = Noise(request.exploration_sigma, request.exploration_correlation)
        due = time.monotonic() + HELD
        for evaluation, controller, aim in zip(request.evaluations, controllers, aims, strict=True):
            if not self.context.ok():
                raise ExternalShutdownException  # other evaluators do the rest of the chunk
            rng = evaluation_rng(request.seed, evaluation)
            acting = exploring(controller, noise, request.seed, evaluation)
            episode = rollout(task, acting, rng)
            episodes.append(episode if aim is None else replace(episode, intended=aim))
            self.count_done()
            self.diagnostics.queue -= 1
            if time.monotonic() >= due or len(episodes) == n:
                for i in range(published, len(episodes)):
                    self._publish(request, request.evaluations[i], episodes[i])
                published, due = len(episodes), time.monotonic() + HELD
        self._answer(response, episodes)

    def _again(
        self, task: Task, request: Evaluate.Request, controllers: list[MlpController]
    ) -> Iterator[Episode]:
        """Yield the episodes of re-evaluations, which nobody learns from."""
        self.diagnostics.run_id = request.run_id
        for left, (repeat, controller) in enumerate(zip(request.repeats, controllers, strict=True)):
            if not self.context.ok():
                raise ExternalShutdownException
            self.diagnostics.queue = len(controllers) - left
            yield rollout(task, controller, reevaluation_rng(request.seed, repeat))
            self.count_done()
        self.diagnostics.queue = 0

    def _answer(self, response: Evaluate.Response, done: Iterable[Episode]) -> None:
        """Put the outcomes of episodes into a response."""
        episodes = list(done)
        response.fitness = flat([e.fitness for e in episodes], "d")
        response.descriptors = flat([e.descriptor for e in episodes], "d")
        response.steps = flat([e.length for e in episodes], "q")
        response.terminated = [bool(e.terminated) for e in episodes]

    def _randomized(self, randomization: str) -> Task:
        """Return the task in which what a request names is another in each episode.

        Besides the sound one, one is kept: an evaluator works for one run at a time.

        Raises:
            RandomizationError: The text makes no sense, or the task cannot be randomized.
        """
        if randomization not in self._tasks:
            task = make_task(self._task_name, randomization)
            for other in [text for text in self._tasks if text]:
                self._tasks.pop(other).close()
            self._tasks[randomization] = task
        return self._tasks[randomization]

    def _require_free_name(self) -> None:
        """Listen for a namesake before offering the service, which would also get the namesake's requests.

        Raises:
            PgaError: Another evaluator has the name.
        """
        leave_to_elders(self, lambda msg: msg.node == self.get_fully_qualified_name(), OTHER_NAME)
        start = time.monotonic()
        while time.monotonic() < start + listening_time(self, self.get_name()):
            rclpy.spin_once(self, timeout_sec=0.1)
            if self.outcome is not None:
                raise self.outcome

    def _wait_for_reader(self) -> None:
        """Give discovery a moment before an episode that no node would receive, and that would have to be repeated.

        This happens if the evaluator has just been started or reconnected to the network. After one timeout without a
        subscriber, stop waiting.
        """
        deadline = time.monotonic() + self._patience
        pause = threading.Event()
        while not (heard := self._experience.get_subscription_count() > 0):
            if time.monotonic() >= deadline or not self.context.ok():
                break
            pause.wait(0.01)
        self._patience = READER_WAIT if heard else 0.0

    def _publish(self, request: Evaluate.Request, evaluation: int, episode: Episode) -> None:
        msg = episode_to_msg(
            episode,
            run_id=request.run_id,
            task=self._task_name,
            evaluator=self.get_fully_qualified_name(),
            generation=request.generation,
            evaluation=evaluation,
        )
        self._experience.publish(msg)

    def _controllers(self, request: Evaluate.Request) -> list[MlpController]:
        """Check a request and return its controllers.

        Raises:
            RequestError: Wrong task, ids, repeats, layers or parameters.
            SettingsError: The noise is out of its range.
        """
        if request.task != self._task_name:
            raise RequestError(
                f"This evaluator simulates '{self._task_name}', not '{request.task}'; "
                "start one with the parameter task set to that."
            )
        ids = np.asarray(request.evaluations, np.int64)
        if ids.size == 0 or min(ids.min(), request.seed, request.generation) < 0:
            raise RequestError(
                "Give at least one evaluation id; ids, seed and generation must be at least 0."
            )
        for field in NOISE:
            checked_value(field, getattr(request, field.name))
        if request.repeats:
            _require_repeats(request)
        shape = layers_from_msg(request.layer_sizes, "layer_sizes")
        if (shape.sizes[0], shape.sizes[-1]) != (self._spec.observation_dim, self._spec.action_dim):
            raise RequestError(
                f"Controllers with layers {shape.sizes} do not fit task '{self._spec.name}', which has "
                f"{self._spec.observation_dim} observations and {self._spec.action_dim} actions."
            )
        parameters = shaped(
            request.parameters, (ids.size, shape.parameter_count), np.float32, "parameters"
        )
        return [MlpController(shape, p) for p in finite(parameters, "parameters")]

    def destroy_node(self) -> None:
        """Close the world, then destroy the node."""
        for task in self._tasks.values():
            task.close()
        super().destroy_node()


def _require_repeats(request: Evaluate.Request) -> None:
    """Check the fields of re-evaluations.

    Raises:
        RequestError: There is not one repeat per controller, one is below 0, or noise is asked for.
    """
    repeats = np.asarray(request.repeats, np.int64)
    if repeats.size != len(request.evaluations) or repeats.min() < 0:
        raise RequestError(
            f"repeats has {repeats.size} entries, the least {repeats.min()}; expected one per evaluation id "
            f"({len(request.evaluations)}), at least 0."
        )
    for field in NOISE:
        if value := getattr(request, field.name):
            raise RequestError(
                f"{field.name} is {value}, but re-evaluations are without noise; give 0."
            )


def _named_by_hand(node: Evaluator) -> bool:
    """Whether a user gave the node its name; generated names are unique, and a run checks its own nodes' names."""
    return node.get_name() != own_name("evaluator") and os.environ.get(PARENT_WATCH) != "1"


PROGRAM = Program(
    "evaluator",
    "Simulates controllers for the runs of its task; joins them from any machine of the network.",
    (EvaluatorSettings,),
)


def main() -> int:
    """Run the evaluator."""
    return run_node(PROGRAM, Evaluator)


if __name__ == "__main__":
    leave(main())
