"""The whole search in one process: Algorithms 3 to 5 of Nilsson & Cully (2021), as ask and tell.

What tells PGA-MAP-Elites from the systems that it is compared with is in `core.systems`.

The node graph does the same work spread over processes; this is what it must agree with, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.elites import NO_PARENT, Operator, Solutions
from pga_me_ros.core.errors import RequestError
from pga_me_ros.core.exploration import as_evaluated
from pga_me_ros.core.make_archive import make_archive
from pga_me_ros.core.make_offspring import Wanted, make_offspring
from pga_me_ros.core.metrics import Metrics, generation_metrics
from pga_me_ros.core.policy import Controller, controller_shape
from pga_me_ros.core.schedule import evaluation_ids, evaluation_rng
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.start_from import Controllers, starting_with
from pga_me_ros.core.systems import Slots, system_of
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.rollout import Episode, rollout
from pga_me_ros.tasks.spec import TaskSpec


@dataclass(frozen=True)
class Batch:
    """Controllers of one generation that are to be evaluated.

    Attributes:
        generation: Number of the generation, from 0.
        evaluations: Ids of the evaluations.
        operators: (b,) int64 values of `Operator`.
        parents: (b, 2) int64 evaluation ids of the parents, `NO_PARENT` for none.
        parameters: (b, P) float32.
    """

    generation: int
    evaluations: range
    operators: NDArray[np.int64]
    parents: NDArray[np.int64]
    parameters: NDArray[np.float32]


class Search:
    """The whole algorithm: `ask` for a batch, evaluate it, `tell` what came out.

    Args:
        spec: Task.
        settings: Settings of the run.
        imported: (n, P) float32 controllers to start with in place of random ones (`start_from.read_controllers`), None
            for none.

    Attributes:
        settings: Settings with the rates in force; may be replaced between generations to change rates.
        archive: The archive so far.
        learner: Critics, greedy controller and replay buffer.
        metrics: Metrics after each generation.
    """

    def __init__(
        self, spec: TaskSpec, settings: Settings, imported: Controllers | None = None
    ) -> None:
        if imported is not None:
            settings = starting_with(settings, imported)
        self.spec = spec
        self.settings = settings
        self._imported = imported
        self.shape = controller_shape(spec, settings)
        self.archive: Archive = make_archive(spec, settings)
        self._system = system_of(settings)
        self.learner = self._system.make_learner(spec, settings)
        self.metrics: list[Metrics] = []
        self._snapshot: Snapshot | None = None

    @property
    def generation(self) -> int:
        """Number of the generation that comes next."""
        return len(self.metrics)

    def ask(self) -> Batch:
        """Make the next generation (Alg. 3 lines 9-13).

        Raises:
            NetworkError: Critic training diverged.
        """
        t, b = self.generation, self.settings.batch_size
        if self._system.needs_snapshot(self.settings, t) and not self._trained_for(t):
            self._train_critic(t)
        operators = np.empty(b, np.int64)
        parents = np.full((b, 2), NO_PARENT, np.int64)
        parameters = np.empty((b, self.shape.parameter_count), np.float32)
        for slots in self._system.batch_plan(self.settings, t, self._imported_count):
            places = slice(slots.first, slots.first + slots.count)
            operators[places] = slots.operator
            parents[places], parameters[places] = self._variation(slots)
        return Batch(t, evaluation_ids(self.settings, t), operators, parents, parameters)

    def tell(self, batch: Batch, episodes: Sequence[Episode]) -> Metrics:
        """Learn from an evaluated generation (Alg. 3 line 14).

        Args:
            batch: What `ask` returned.
            episodes: Its episodes, in order.

        Returns:
            Metrics of the archive after this generation.

        Raises:
            RequestError: The batch is not that of the generation that comes next.
            ArchiveError: The episodes do not fit the batch, or a fitness or descriptor is not finite.
        """
        if batch.generation != self.generation:
            raise RequestError(
                f"Generation {batch.generation} was told, but {self.generation} comes next; tell each "
                "batch once, in the order of ask."
            )
        if self._system.trains_meanwhile(self.settings, batch.generation):
            self._train_critic(batch.generation + 1)  # on the experience up to generation - 1
        solutions = Solutions.of(
            fitness=[e.fitness for e in episodes],
            descriptors=[e.descriptor for e in episodes],
            parameters=batch.parameters,
            evaluations=batch.evaluations,
            generation=batch.generation,
            operators=batch.operators,
            parents=batch.parents,
            steps=[e.length for e in episodes],
            terminated=[e.terminated for e in episodes],
        )
        self.learner.add(batch.generation, episodes)
        added = self.archive.add(solutions, self._system.offered(solutions.operators))
        before = self.metrics[-1] if self.metrics else None
        self.metrics.append(
            generation_metrics(self.archive, solutions, added, batch.generation, before)
        )
        return self.metrics[-1]

    def run_generation(self, task: Task) -> Metrics:
        """Ask, evaluate in this process, tell."""
        batch = self.ask()
        s = self.settings
        episodes = [
            rollout(task, as_evaluated(s, Controller(self.shape, p), k), evaluation_rng(s.seed, k))
            for k, p in zip(batch.evaluations, batch.parameters, strict=True)
        ]
        return self.tell(batch, episodes)

    @property
    def _imported_count(self) -> int:
        return 0 if self._imported is None else len(self._imported)

    def _trained_for(self, generation: int) -> bool:
        return self._snapshot is not None and self._snapshot.generation == generation

    def _train_critic(self, generation: int) -> None:
        """Train the critics for a generation's offspring (Alg. 3 line 12)."""
        if self._snapshot is None and self.settings.greedy_init == "best":
            self.learner.start_greedy_at(self.archive.best().parameters)
        self._snapshot = self.learner.train(self.settings, generation)

    def _variation(self, slots: Slots) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Make the offspring of one operator (Alg. 5); returns evaluation ids of parents, and parameters."""
        s, t, first, n = self.settings, self.generation, slots.first, slots.count
        parents = np.full((n, 2), NO_PARENT, np.int64)
        if slots.operator == Operator.IMPORTED:
            assert self._imported is not None
            return parents, self._imported[evaluation_ids(s, t)[first : first + n]]
        if slots.operator == Operator.GREEDY:
            assert self._snapshot is not None
            return parents, self._snapshot.greedy[None]
        each = self._system.parents.get(slots.operator, 0)
        chosen = np.empty((n, 0, self.shape.parameter_count), np.float32)
        if each:
            cells = self._system.choose_parents(self.archive, s, t, first, n, each)
            parents[:, :each] = self.archive.evaluations[cells]
            chosen = self.archive.parameters[cells]
        wanted = Wanted(s, self.shape, t, first, n, chosen, self._snapshot)
        return parents, make_offspring(slots.operator, wanted)
