"""Evaluator: one simulated world that turns controllers into fitness, descriptor and experience."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import dataclass
from importlib.metadata import version

os.environ.setdefault(
    "OPENBLAS_NUM_THREADS", "1"
)  # one episode is one thread: worlds scale, BLAS must not

import numpy as np
from pga_me_msgs.msg import Transitions
from pga_me_msgs.srv import Evaluate
from rclpy.executors import ExternalShutdownException

from pga_me_ros.core.errors import RequestError
from pga_me_ros.core.policy import Controller, MlpShape
from pga_me_ros.core.schedule import evaluation_rng
from pga_me_ros.core.setting_field import setting
from pga_me_ros.core.settings import Settings
from pga_me_ros.nodes.options import RunOptions
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.convert import episode_to_msg, finite, flat, shaped
from pga_me_ros.ros.graph_node import GraphNode, own_name
from pga_me_ros.ros.parameters import declare
from pga_me_ros.ros.process import run_node
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import Episode, rollout

READER_WAIT = 2.0
"""Seconds that the first evaluation waits for a reader of its experience; the trainer's may still be on its way."""


@dataclass(frozen=True)
class EvaluatorSettings:
    """Parameters of an evaluator: all else comes with each request, so it serves any run of its task."""

    task: str = setting("qd_walker", "Simulated robot: a built-in task, or module.path:ClassName.")


class Evaluator(GraphNode):
    """Simulates controllers for whoever asks, and publishes what they experienced."""

    def __init__(self) -> None:
        super().__init__("evaluator", own_name("evaluator"))
        self._task_name = declare(self, EvaluatorSettings, shared=(Settings, RunOptions))["task"]
        self._task = make_task(self._task_name)
        self._spec = self._task.spec
        self._experience = self.create_publisher(
            Transitions, names.TRANSITIONS, qos.EXPERIENCE_WRITER
        )
        self._heard_of = False
        self.serve(Evaluate, names.EVALUATE, self._evaluate)
        libraries = ", ".join(f"{name} {version(name)}" for name in ("pybullet", "numpy"))
        self.start_heartbeat(task=self._task_name, versions=libraries)

    def _evaluate(self, request: Evaluate.Request, response: Evaluate.Response) -> None:
        controllers = self._controllers(request)
        episodes: list[Episode] = []
        self._wait_for_reader()
        for evaluation, controller in zip(request.evaluations, controllers, strict=True):
            if not self.context.ok():
                raise ExternalShutdownException  # others do what is left of the chunk
            rng = evaluation_rng(request.seed, evaluation)
            episode = rollout(self._task, controller, rng)
            episodes.append(episode)
            self._publish(request, evaluation, episode)
            self.count_done()
        response.fitness = flat([e.fitness for e in episodes], "d")
        response.descriptors = flat([e.descriptor for e in episodes], "d")
        response.steps = flat([e.length for e in episodes], "q")
        response.terminated = [bool(e.terminated) for e in episodes]

    def _wait_for_reader(self) -> None:
        """Give discovery a moment before the first episode, which would be done again if nobody heard of it."""
        deadline = time.monotonic() + READER_WAIT
        pause = threading.Event()
        while not self._heard_of and time.monotonic() < deadline and self.context.ok():
            self._heard_of = self._experience.get_subscription_count() > 0
            pause.wait(0.0 if self._heard_of else 0.01)
        self._heard_of = True

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

    def _controllers(self, request: Evaluate.Request) -> list[Controller]:
        """Check a request and return its controllers.

        Raises:
            RequestError: Wrong task, ids, layers or parameters.
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
        shape = MlpShape(tuple(int(n) for n in request.layer_sizes))
        if (shape.sizes[0], shape.sizes[-1]) != (self._spec.observation_dim, self._spec.action_dim):
            raise RequestError(
                f"Controllers with layers {shape.sizes} do not fit task '{self._spec.name}', which has "
                f"{self._spec.observation_dim} observations and {self._spec.action_dim} actions."
            )
        parameters = shaped(
            request.parameters, (ids.size, shape.parameter_count), np.float32, "parameters"
        )
        return [Controller(shape, p) for p in finite(parameters, "parameters")]

    def destroy_node(self) -> None:
        """Close the world, then destroy the node."""
        self._task.close()
        super().destroy_node()


PROGRAM = Program(
    "evaluator",
    "Simulates controllers for the runs of its task; joins them from any machine of the network.",
    (EvaluatorSettings,),
)


def main() -> int:
    """Run the evaluator."""
    return run_node(PROGRAM, Evaluator)


if __name__ == "__main__":
    raise SystemExit(main())
