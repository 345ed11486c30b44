"""Critic trainer: collects experience, trains the critics, and publishes what PG variation needs."""

from __future__ import annotations

import os
import traceback
from importlib.metadata import version
from pathlib import Path

import numpy as np
from pga_me_msgs.msg import CriticSnapshot, Transitions
from pga_me_msgs.srv import StoreExperience, Train

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.plan import TrainingOrder
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.training.resumable_learner import ResumableLearner
from pga_me_ros.core.training.training_queue import TrainingQueue
from pga_me_ros.errors import PgaError, RequestError
from pga_me_ros.process.ending import leave
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.convert import episode_from_msg, finite, shaped, snapshot_to_msg, with_rates
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.ros.options import ChildOptions, require_run
from pga_me_ros.ros.parameters import declare_run
from pga_me_ros.ros.process import run_node
from pga_me_ros.tasks.registry import task_spec

CRITICS = 2
"""Number of threads that can train in parallel: one per critic."""


class CriticTrainerNode(GraphNode):
    """Owns replay buffer, critics and greedy controller, and keeps receiving messages while it trains."""

    def __init__(self) -> None:
        super().__init__("critic_trainer")
        self._settings, options = declare_run(self, ChildOptions, fixed=True)
        self._run_id = require_run(options, "critic_trainer")
        self._spec = task_spec(self._settings.task)
        run_dir = Path(options["run_dir"])
        workers = min(os.cpu_count() or 1, CRITICS)
        self._learner = ResumableLearner(self._spec, self._settings, run_dir, workers)
        self._trainings = TrainingQueue(self._learner, self._trained, self._failed)
        self._snapshots = self.create_publisher(CriticSnapshot, names.SNAPSHOT, qos.LATCHED)
        self.create_subscription(
            Transitions, names.TRANSITIONS, self._take_episode, qos.EXPERIENCE_READER
        )
        self.serve(Train, names.TRAIN, self._train)
        self.serve(StoreExperience, names.STORE_EXPERIENCE, self._store)
        self.start_heartbeat(
            run_id=self._run_id, task=self._settings.task, versions=f"torch {version('torch')}"
        )

    def _take_episode(self, msg: Transitions) -> None:
        try:
            self.check_run(msg.run_id, self._run_id)
            with self._trainings.lock:
                self._stage(msg)
        except PgaError as error:
            self.refused(f"dropped an episode: {error}")

    def _stage(self, msg: Transitions) -> None:
        experience = self._learner.experience
        if 0 <= msg.generation < experience.stored:
            return  # of an evaluation that was given to two evaluators: the run has passed it
        if not experience.awaits(msg.generation):
            raise RequestError(
                f"Evaluation {msg.evaluation} is of generation {msg.generation}, which is over or far ahead."
            )
        episode = episode_from_msg(msg, self._spec)
        episode = algorithm_of(self._settings).remembered(episode)
        experience.stage(msg.generation, msg.evaluation, episode)

    def _store(self, request: StoreExperience.Request, response: StoreExperience.Response) -> None:
        self.check_run(request.run_id, self._run_id)
        b = self._settings.batch_size
        fitness = finite(shaped(request.fitness, (b,), np.float64, "fitness"), "fitness")
        experience = self._learner.experience
        with self._trainings.lock:
            experience.expect(request.generation)
            experience.drop_others(request.generation, fitness)
            missing = experience.missing(request.generation)
            if not missing:
                experience.store(request.generation)
        if missing:
            response.accepted = False
            response.missing = missing
            response.message = f"{len(missing)} episodes have not arrived."

    def _train(self, request: Train.Request, response: Train.Response) -> None:
        self.check_run(request.run_id, self._run_id)
        settings = with_rates(self._settings, request.rates)
        order = TrainingOrder.of(request.generation, request.experience, settings)
        self._check_order(order)
        done = self._trainings.order(order, request.after, self._greedy_start(request))
        self.diagnostics.queue = len(self._trainings)
        if done:
            self._publish(done)

    def _check_order(self, order: TrainingOrder) -> None:
        """Refuse a training that the generation loop never orders.

        Its outcome would replace later ones: see `CriticCheckpoints.save`.

        Raises:
            RequestError: The order is for a generation that is over, or has the wrong generation's experience.
        """
        stored = self._learner.experience.stored
        if order.generation <= stored:
            raise RequestError(
                f"Training for generation {order.generation} comes too late: generation {stored} is stored."
            )
        if order.experience < -1 or not 1 <= order.generation - order.experience <= 2:
            raise RequestError(
                f"Training for generation {order.generation} on the experience up to {order.experience} makes no "
                "sense; expected one or two generations less."
            )

    def _greedy_start(self, request: Train.Request) -> Float32Array | None:
        """Return the (P,) start of the greedy controller, None for a random start."""
        if self._settings.greedy_init != "best":
            if len(request.greedy):
                raise RequestError(
                    "A controller is given, but in this run the greedy one starts at random; send none."
                )
            return None
        count = controller_shape(self._spec, self._settings).parameter_count
        return shaped(request.greedy, (count,), np.float32, "greedy").copy()

    def _trained(self, snapshot: Snapshot) -> None:
        self.count_done()
        self.diagnostics.queue = len(self._trainings)
        self._publish(snapshot)

    def _publish(self, snapshot: Snapshot) -> None:
        self._snapshots.publish(snapshot_to_msg(snapshot, self._run_id))

    def _failed(self, error: Exception) -> None:
        self.diagnostics.queue = 0
        if not isinstance(error, PgaError):
            self.get_logger().error("".join(traceback.format_exception(error)))
        reason = f"training failed: {self._trainings.fault}"
        self.refused(reason)
        self.diagnostics.fault(reason)


PROGRAM = Program(
    "critic_trainer",
    "Collects experience and trains the critics of a run; the orchestrator starts it.",
    (Settings, ChildOptions),
)


def main() -> int:
    """Run the critic trainer."""
    return run_node(PROGRAM, CriticTrainerNode)


if __name__ == "__main__":
    leave(main())
