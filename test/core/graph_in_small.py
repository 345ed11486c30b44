"""A run as the graph carries it out, without ROS: training orders, learner on disk, offspring in pieces."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from lane_task import Lane

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.durable_learner import DurableLearner
from pga_me_ros.core.elites import NO_PARENT, Operator, Solutions
from pga_me_ros.core.exploration import as_evaluated
from pga_me_ros.core.make_archive import make_archive
from pga_me_ros.core.make_offspring import Wanted, make_offspring
from pga_me_ros.core.policy import Controller, controller_shape
from pga_me_ros.core.schedule import (
    TrainingOrder,
    evaluation_ids,
    evaluation_rng,
    training_for,
    training_meanwhile,
)
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.systems import system_of
from pga_me_ros.tasks.rollout import rollout

PIECE = 3


class GraphInSmall:
    """Archive and learner of a run.

    Args:
        settings: Settings of the run.
        folder: Folder of the run.
        rates: Settings from each of these generations on.
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
        self._system = system_of(settings)
        self._shape = controller_shape(task.spec, settings)
        self._task = task()
        self.archive: Archive = make_archive(task.spec, settings)
        self.restart_learner()

    def restart_learner(self) -> None:
        """Lose everything that is only in the learner's memory."""
        self.learner = DurableLearner(self._task.spec, self._settings, self._folder)

    def grow(
        self,
        generations: range,
        restarts: Collection[int] = (),
        late_restarts: Collection[int] = (),
    ) -> None:
        """Do generations; the learner dies before those of `restarts`, and before storing those of `late_restarts`."""
        for t in generations:
            if t in restarts:
                self.restart_learner()
            self._generation(t, dies_late=t in late_restarts)

    def _rates_for(self, t: int) -> Settings:
        return self._rates[max(g for g in self._rates if g <= max(t, 0))]

    def trained(self, order: TrainingOrder) -> Snapshot:
        """Return the outcome of a training that is durable, or is now."""
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
        orders = (training_for(s, self._rates_for(t - 1), t), training_meanwhile(s, t))
        snapshot, _ = (order and self.trained(order) for order in orders)
        operators, parents, parameters = self._offspring(s, t, snapshot)
        ids = evaluation_ids(s, t)
        episodes = [
            rollout(
                self._task,
                as_evaluated(s, Controller(self._shape, p), k),
                evaluation_rng(s.seed, k),
            )
            for k, p in zip(ids, parameters, strict=True)
        ]
        if dies_late:
            self.restart_learner()
        for k in reversed(ids):
            episode = self._system.remembered(episodes[k - ids.start])
            self.learner.experience.stage(t, k, episode)
        self.learner.experience.store(t)
        solutions = Solutions.of(
            fitness=[e.fitness for e in episodes],
            descriptors=[e.descriptor for e in episodes],
            parameters=parameters,
            evaluations=ids,
            generation=t,
            operators=operators,
            parents=parents,
            steps=[e.length for e in episodes],
            terminated=[e.terminated for e in episodes],
        )
        self.archive.add(solutions, self._system.offered(solutions.operators))

    def _offspring(
        self, s: Settings, t: int, snapshot: Snapshot | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        b = s.batch_size
        operators = np.zeros(b, np.int64)
        parents = np.full((b, 2), NO_PARENT, np.int64)
        parameters = np.zeros((b, self._shape.parameter_count), np.float32)
        for slots in self._system.batch_plan(s, t):
            end = slots.first + slots.count
            for first in range(slots.first, end, PIECE):
                places = slice(first, min(first + PIECE, end))
                operators[places] = slots.operator
                ids, made = self._made(s, t, snapshot, slots.operator, first, places.stop - first)
                parents[places, : ids.shape[1]], parameters[places] = ids, made
        return operators, parents, parameters

    def _made(
        self, s: Settings, t: int, snapshot: Snapshot | None, operator: Operator, first: int, n: int
    ) -> tuple[np.ndarray, np.ndarray]:
        if operator == Operator.GREEDY:
            assert snapshot is not None
            return np.empty((n, 0)), snapshot.greedy[None]
        each = self._system.parents.get(operator, 0)
        ids, chosen = np.empty((n, 0)), np.empty((n, 0, self._shape.parameter_count), np.float32)
        if each:
            cells = self._system.choose_parents(self.archive, s, t, first, n, each)
            ids, chosen = self.archive.evaluations[cells], self.archive.parameters[cells]
        return ids, make_offspring(operator, Wanted(s, self._shape, t, first, n, chosen, snapshot))
