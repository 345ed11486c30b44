"""Critic trainer: collects experience, trains the critics, publishes what PG variation needs."""

from __future__ import annotations

import threading
from importlib.metadata import version
from pathlib import Path

import numpy as np
from pga_me_msgs.msg import CriticSnapshot, Transitions
from pga_me_msgs.srv import StoreExperience, Train

from pga_me_ros.core.critic_checkpoint import CriticCheckpoints
from pga_me_ros.core.errors import PgaError, RequestError
from pga_me_ros.core.experience import Experience
from pga_me_ros.core.learner import Learner
from pga_me_ros.core.policy import controller_shape
from pga_me_ros.core.schedule import TrainingOrder
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.nodes.options import ChildOptions
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import episode_from_msg, shaped, snapshot_to_msg, with_rates
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.ros.parameters import declare_run
from pga_me_ros.ros.process import run_node
from pga_me_ros.tasks.registry import task_spec


class CriticTrainerNode(GraphNode):
    """Owns replay buffer, critics and greedy controller; trains in a thread while it goes on listening."""

    def __init__(self) -> None:
        super().__init__("critic_trainer")
        self._settings, options = declare_run(self, ChildOptions)
        self._run_id = options["run_id"]
        self._spec = task_spec(self._settings.task)
        run_dir = Path(options["run_dir"])
        self._experience = Experience(run_dir / "experience", self._settings)
        self._checkpoints = CriticCheckpoints(run_dir)
        self._learner = Learner(self._spec, self._settings)
        self._trained_for = -1
        self._training: TrainingOrder | None = None
        self._fault = ""
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
            episode = episode_from_msg(msg, self._spec)
            self._experience.stage(msg.generation, msg.evaluation, episode)
        except PgaError as error:
            self.refused(f"dropped an episode: {error}")

    def _store(self, request: StoreExperience.Request, response: StoreExperience.Response) -> None:
        self.check_run(request.run_id, self._run_id)
        missing = self._experience.missing(request.generation)
        if missing:
            response.accepted = False
            response.missing = missing
            response.message = f"{len(missing)} episodes have not arrived."
        else:
            self._experience.store(request.generation)

    def _train(self, request: Train.Request, response: Train.Response) -> None:
        self.check_run(request.run_id, self._run_id)
        if self._fault:
            raise RequestError(self._fault)
        settings = with_rates(self._settings, request.rates)
        order = TrainingOrder.of(request.generation, request.experience, settings)
        done = self._checkpoints.find(order)
        if done:
            self._publish(done[0])
        elif self._training is None:
            self._prepare(order, request.greedy)
            self._training = order
            work = threading.Thread(target=self._work, args=(order, settings), daemon=True)
            work.start()
        elif self._training != order:
            raise RequestError(
                f"Training for generation {self._training.generation} is under way; wait for its "
                "snapshot."
            )

    def _prepare(self, order: TrainingOrder, greedy: object) -> None:
        """Bring critics and replay buffer into the state that a training starts from.

        Raises:
            RequestError: The experience is not here, or the start of the greedy controller does not fit.
            StorageError: A stored file is damaged.
        """
        if self._trained_for >= order.generation or self._trained_for < 0:
            self._return_to_before(order.generation)
        if self._trained_for < 0 and self._settings.greedy_init == "best":
            count = controller_shape(self._spec, self._settings).parameter_count
            self._learner.start_greedy_at(shaped(greedy, (count,), np.float32, "greedy").copy())
        if self._learner.newest > order.experience:
            self._learner.forget_experience()
        if self._learner.newest < 0:
            wanted = self._experience.window(order.experience)
        else:
            wanted = range(self._learner.newest + 1, order.experience + 1)
        for generation in wanted:
            self._learner.add(generation, self._experience.episodes(generation))

    def _return_to_before(self, generation: int) -> None:
        """Load the newest state that was reached before the training for a generation."""
        earlier = self._checkpoints.before(generation)
        if earlier:
            snapshot, state = earlier
            self._learner.load_state(state, snapshot.version)
            self._trained_for = snapshot.generation
        elif self._trained_for >= 0:
            self._learner = Learner(self._spec, self._settings)
            self._trained_for = -1

    def _work(self, order: TrainingOrder, settings: Settings) -> None:
        """Train in a thread of its own; torch lets the executor run meanwhile."""
        try:
            snapshot = self._learner.train(settings, order.generation)
            self._checkpoints.save(order, snapshot, self._learner.state())
        except PgaError as error:
            self._fault = str(error)
            self.refused(f"training failed: {error}")
        else:
            self._trained_for = order.generation
            self.count_done()
            self._publish(snapshot)
        finally:
            self._training = None

    def _publish(self, snapshot: Snapshot) -> None:
        self._snapshots.publish(snapshot_to_msg(snapshot, self._run_id))


def main() -> int:
    """Run the critic trainer."""
    return run_node(CriticTrainerNode)


if __name__ == "__main__":
    raise SystemExit(main())
