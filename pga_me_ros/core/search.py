"""The whole search in one process: Algorithms 3 to 5 of Nilsson & Cully (2021), as ask and tell.

What distinguishes PGA-MAP-Elites from the algorithms that it is compared with is in `core.algorithms`.

The node graph distributes the same work over processes, and must give the same result, bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pga_me_ros.core.algorithms import Slots, algorithm_of
from pga_me_ros.core.algorithms.learners import make_learner
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.depth import CellDepth
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.archive.metrics import Metrics, generation_metrics
from pga_me_ros.core.batch import Batch
from pga_me_ros.core.evaluation import as_evaluated, evaluation_rng
from pga_me_ros.core.networks.conditioned import conditions
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.operators import OPERATORS, Operator
from pga_me_ros.core.plan import GenerationPlan, TrainingOrder
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import GREEDY, Snapshot
from pga_me_ros.core.variation.imported_controllers import Controllers, starting_with
from pga_me_ros.core.variation.make_offspring import OffspringRequest, make_offspring
from pga_me_ros.errors import RequestError, SettingsError
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.rollout import Episode, rollout
from pga_me_ros.tasks.spec import TaskSpec


class Search:
    """The whole algorithm: `ask` for a batch, evaluate it, `tell` the results.

    Args:
        spec: Task.
        settings: Settings of the run.
        imported: (n, P) float32 controllers to start with instead of random ones (`start_from.read_controllers`), None
            for none.

    Attributes:
        settings: Settings with the rates in force; may be replaced between generations to change rates.
        archive: The archive so far.
        depth: What its cells hold below their elites; None where nothing is evaluated again (`extract_share`).
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
        self.shape = controller_shape(spec, settings)
        self.archive: Archive = make_archive(spec, settings)
        self.depth = CellDepth(self.archive, settings.cell_depth) if settings.extracted else None
        self.learner = make_learner(spec, settings)
        self.metrics: list[Metrics] = []
        self._imported = None if imported is None else np.array(imported, np.float32)
        self._before = settings
        self._snapshot: Snapshot | None = None
        self._trained: TrainingOrder | None = None

    @property
    def generation(self) -> int:
        """Number of the generation that comes next."""
        return len(self.metrics)

    @property
    def trained(self) -> tuple[TrainingOrder, Snapshot] | None:
        """The newest training and its outcome, None before the first."""
        return (self._trained, self._snapshot) if self._trained and self._snapshot else None

    def run_generation(self, task: Task) -> Metrics:
        """Ask, evaluate in this process, and tell.

        Raises:
            SettingsError: The task is not randomized as the settings say; make it by
                ``make_task(settings.task, settings.randomization)``.
        """
        s = self.settings
        randomized = getattr(task, "randomization", "")
        if randomized != s.randomization:
            raise SettingsError(
                f"randomization is '{s.randomization}', but the task was made with '{randomized}'; make it by "
                "make_task(settings.task, settings.randomization)."
            )
        batch = self.ask()
        episodes = [
            rollout(
                task, as_evaluated(s, MlpController(self.shape, p), k), evaluation_rng(s.seed, k)
            )
            for k, p in zip(batch.evaluations, batch.parameters, strict=True)
        ]
        return self.tell(batch, episodes)

    def ask(self) -> Batch:
        """Make the next generation (Alg. 3 lines 9-13).

        Raises:
            NetworkError: Critic training diverged.
        """
        plan = self._plan()
        if plan.training:
            self._train_critic(plan.training)
        count, dimensions = self.shape.parameter_count, self.spec.descriptor_dim
        batch = Batch.empty(plan.generation, plan.evaluations, count, dimensions)
        for slots in plan.slots:
            self._fill(batch, plan, slots)
        return batch

    def tell(self, batch: Batch, episodes: Sequence[Episode]) -> Metrics:
        """Learn from an evaluated generation (Alg. 3 line 14).

        Args:
            batch: The batch returned by `ask`.
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
        plan = self._plan()
        if plan.meanwhile:
            self._train_critic(plan.meanwhile)
        solutions = batch.solutions(episodes)
        self.learner.add(batch.generation, batch.with_aims(episodes))
        offered = algorithm_of(self.settings).offered(solutions.operators)
        deep = self.depth
        added = deep.add(solutions, offered).added if deep else self.archive.add(solutions, offered)
        before = self.metrics[-1] if self.metrics else None
        self.metrics.append(
            generation_metrics(self.archive, solutions, added, batch.generation, before)
        )
        self._before = plan.settings
        return self.metrics[-1]

    def _plan(self) -> GenerationPlan:
        imported = 0 if self._imported is None else len(self._imported)
        return GenerationPlan.of(self.settings, self._before, self.generation, imported)

    def _train_critic(self, order: TrainingOrder) -> None:
        """Train the critics for a generation's offspring (Alg. 3 line 12), unless that was done already."""
        if self._snapshot is None:
            if self.settings.greedy_init == "best":
                self.learner.start_greedy_at(self.archive.best().parameters)
        elif self._snapshot.generation == order.generation:
            return
        self._snapshot = self.learner.train(self.settings, order.generation)
        self._trained = order

    def _fill(self, batch: Batch, plan: GenerationPlan, slots: Slots) -> None:
        """Make the offspring of one operator (Alg. 5)."""
        s, t, first, n = plan.settings, plan.generation, slots.first, slots.count
        places = slice(first, first + n)
        batch.operators[places] = slots.operator
        if slots.operator == Operator.IMPORTED:
            assert self._imported is not None
            batch.parameters[places] = self._imported[plan.evaluations[places]]
            return
        if slots.operator == Operator.EXTRACTED:
            assert self.depth is not None
            drawn = self.depth.draw(s.seed, t, n)
            batch.parents[places, 0], batch.parameters[places] = drawn, self.depth.parameters(drawn)
            return
        if slots.operator == Operator.GREEDY:
            assert self._snapshot is not None
            batch.parameters[places] = self._snapshot.parameters(GREEDY)
            return
        algorithm, each = algorithm_of(s), OPERATORS[slots.operator].parents
        cells = np.empty((n, 0), np.int64)
        if each:
            cells = algorithm.choose_parents(self.archive, s, t, first, n, each)
            batch.parents[places, :each] = self.archive.evaluations[cells]
        aims = algorithm.intended(slots.operator, self.archive.descriptors[cells])
        conditioned = None
        if aims is not None:
            batch.intended[places], conditioned = aims, conditions(aims, self.spec)
        parents = self.archive.parameters[cells]
        request = OffspringRequest(
            s, self.shape, t, first, n, parents, self._snapshot, conditions=conditioned
        )
        batch.parameters[places] = make_offspring(slots.operator, request)
