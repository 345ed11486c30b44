"""A run as in the graph, but without ROS: training orders, learner on disk, offspring in pieces."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from lane_task import Lane

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.batch import Batch
from pga_me_ros.core.evaluation import as_evaluated, evaluation_rng
from pga_me_ros.core.networks.conditioned import conditions
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.operators import OPERATORS, Operator
from pga_me_ros.core.plan import GenerationPlan, TrainingOrder
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.training.resumable_learner import ResumableLearner
from pga_me_ros.core.variation.make_offspring import OffspringRequest, make_offspring
from pga_me_ros.tasks.rollout import rollout

PIECE = 3


class GraphInSmall:
    """Archive and learner of a run.

    Args:
        settings: Settings of the run.
        folder: Folder of the run.
        rates: Settings by the generation from which they apply.
        task: Class of the task.
    """

    def __init__(
        self,
        settings: Settings,
        folder: Path,
        rates: Mapping[int, Settings] | None = None,
        task: type[Lane] = Lane,
    ) -> None:
        self._settings, self._folder = settings, folder
        self._rates = {0: settings, **(rates or {})}
        self._algorithm = algorithm_of(settings)
        self._shape = controller_shape(task.spec, settings)
        self._task = task()
        self.archive: Archive = make_archive(task.spec, settings)
        self.restart_learner()

    def restart_learner(self) -> None:
        """Forget everything that is only in the learner's memory."""
        self.learner = ResumableLearner(self._task.spec, self._settings, self._folder)

    def grow(
        self,
        generations: range,
        restarts: Collection[int] = (),
        late_restarts: Collection[int] = (),
    ) -> None:
        """Carry out generations; the learner dies before `restarts`, and before storing `late_restarts`."""
        for t in generations:
            if t in restarts:
                self.restart_learner()
            self._generation(t, dies_late=t in late_restarts)

    def _rates_for(self, t: int) -> Settings:
        return self._rates[max(g for g in self._rates if g <= max(t, 0))]

    def trained(self, order: TrainingOrder) -> Snapshot:
        """Return the outcome of a training, and store it if it is not stored yet."""
        done = self.learner.find(order)
        if done:
            return done
        start = None
        if self._settings.greedy_init == "best":
            start = self.archive.best().parameters
        self.learner.prepare(order, start)
        trained = self.learner.train(order)
        self.learner.save(trained)
        return trained.snapshot

    def _generation(self, t: int, *, dies_late: bool) -> None:
        s = self._rates_for(t)
        plan = GenerationPlan.of(s, self._rates_for(t - 1), t)
        snapshot, _ = (order and self.trained(order) for order in (plan.training, plan.meanwhile))
        batch = self._offspring(plan, snapshot)
        ids = batch.evaluations
        episodes = [
            rollout(
                self._task,
                as_evaluated(s, MlpController(self._shape, p), k),
                evaluation_rng(s.seed, k),
            )
            for k, p in zip(ids, batch.parameters, strict=True)
        ]
        if dies_late:
            self.restart_learner()
        told = batch.with_aims(episodes)
        for k in reversed(ids):
            episode = self._algorithm.remembered(told[k - ids.start])
            self.learner.experience.stage(t, k, episode)
        self.learner.experience.store(t)
        solutions = batch.solutions(episodes)
        self.archive.add(solutions, self._algorithm.offered(solutions.operators))

    def _offspring(self, plan: GenerationPlan, snapshot: Snapshot | None) -> Batch:
        count, dimensions = self._shape.parameter_count, self._task.spec.descriptor_dim
        batch = Batch.empty(plan.generation, plan.evaluations, count, dimensions)
        for slots in plan.slots:
            end = slots.first + slots.count
            for first in range(slots.first, end, PIECE):
                places = slice(first, min(first + PIECE, end))
                n = places.stop - first
                batch.operators[places] = slots.operator
                ids, aims, made = self._made(
                    plan.settings, plan.generation, snapshot, slots.operator, first, n
                )
                batch.parents[places, : ids.shape[1]], batch.parameters[places] = ids, made
                batch.intended[places] = np.nan if aims is None else aims
        return batch

    def _made(
        self, s: Settings, t: int, snapshot: Snapshot | None, operator: Operator, first: int, n: int
    ) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        if operator == Operator.GREEDY:
            assert snapshot is not None
            return np.empty((n, 0)), None, snapshot.parameters("greedy")[None]
        each = OPERATORS[operator].parents
        cells = np.empty((n, 0), np.int64)
        if each:
            cells = self._algorithm.choose_parents(self.archive, s, t, first, n, each)
        ids, chosen = self.archive.evaluations[cells], self.archive.parameters[cells]
        aims = self._algorithm.intended(operator, self.archive.descriptors[cells])
        scaled = None if aims is None else conditions(aims, self._task.spec)
        request = OffspringRequest(s, self._shape, t, first, n, chosen, snapshot, conditions=scaled)
        return ids, aims, make_offspring(operator, request)
