"""What the generation loop asks of the algorithm that it carries out: pure functions of settings and generation.

`core.search` (one process) and the orchestrator (many) both ask through `core.plan`, so that they cannot drift apart.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.networks.shapes import controller_shape, critic_shape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import CRITIC, GREEDY
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec


@dataclass(frozen=True)
class Slots:
    """Consecutive places of a batch that one operator fills.

    Attributes:
        operator: What makes them.
        first: Place of the first in the batch, from 0.
        count: How many.
    """

    operator: Operator
    first: int
    count: int


def without_extraction(settings: Settings) -> Settings:
    """Return settings of a batch that is as much smaller as solutions are evaluated again in it.

    Where the number of GA offspring was given, it shrinks with the batch.
    """
    if not settings.extracted:
        return settings
    left = settings.batch_size - settings.extracted
    changes: dict[str, Any] = {"batch_size": left, "extract_share": 0.0, "cell_depth": 1}
    if "n_evo" in settings.given:
        changes["n_evo"] = round(settings.n_evo * left / settings.batch_size)
    return settings.replace(**changes)


class Algorithm(ABC):
    """An algorithm that fills an archive; instances have no state.

    What most of them have in common is here: random controllers first, no critics, every solution offered, parents
    drawn uniformly. `core.settings.rules` has its defaults and what it refuses, `learners` what it learns with.

    Attributes:
        name: Value of the setting `algorithm`.
        title: Name for people, as in the paper.
        operators: What makes its offspring, after the random or imported controllers at the start.
        learns_critics: Whether it learns critics; it may learn something else, or nothing.
        conditioned: Whether its critics, and an actor, are conditioned on a descriptor.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    operators: ClassVar[tuple[Operator, ...]]
    learns_critics: ClassVar[bool] = True
    conditioned: ClassVar[bool] = False

    def check_task(self, spec: TaskSpec) -> None:  # noqa: B027 - most algorithms take every task
        """Make sure that a task offers what the algorithm needs beyond what every task has.

        Raises:
            TaskError: The task lacks something that the algorithm needs.
        """

    def batch_plan(self, settings: Settings, generation: int, imported: int = 0) -> list[Slots]:
        """Return which operator fills which places of a generation's batch.

        Imported and then random controllers in the first ceil(G / b) generations; afterwards what `offspring` says of a
        batch without the places at its end, in which solutions of the archive are evaluated again (Extract-MAP-Elites).

        Args:
            settings: Settings with the rates in force.
            generation: Number of the generation, from 0.
            imported: Controllers that the run starts with in place of random ones, at most `random_init`.

        Returns:
            Slots that cover the places 0..b-1 in order, none of them empty.
        """
        b = settings.batch_size
        if generation < settings.init_generations:
            n = min(max(imported - generation * b, 0), b)
            plan = [Slots(Operator.IMPORTED, 0, n), Slots(Operator.RANDOM, n, b - n)]
        else:
            left = b - settings.extracted
            plan = self.offspring(without_extraction(settings), generation)
            plan = [*plan, Slots(Operator.EXTRACTED, left, settings.extracted)]
        return [slots for slots in plan if slots.count]

    @abstractmethod
    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Return the plan of a generation after the random ones; the caller drops empty slots."""

    def uses_critics(self, settings: Settings) -> bool:
        """Whether anything is learned at all, with the rates in force."""
        return False

    def snapshot_networks(self, spec: TaskSpec, settings: Settings) -> Mapping[str, MlpShape]:
        """Return the layers of each network that its snapshots have, by name: what critics are learned with.

        Args:
            spec: Task of the run.
            settings: Settings of the run.
        """
        return {CRITIC: critic_shape(spec, settings), GREEDY: controller_shape(spec, settings)}

    def needs_snapshot(self, settings: Settings, generation: int) -> bool:
        """Whether this generation cannot be made without what was learned for it."""
        return generation >= settings.init_generations and self.uses_critics(settings)

    def trains_meanwhile(self, settings: Settings, generation: int) -> bool:
        """Whether the next generation's training overlaps with the evaluation of this one.

        It is then on the experience up to ``generation - 1``. Otherwise each generation's training takes place before
        the generation is made, on all experience so far.
        """
        return False

    def choose_parents(
        self,
        archive: Archive,
        settings: Settings,
        generation: int,
        first: int,
        count: int,
        each: int,
    ) -> Int64Array:
        """Draw parents uniformly over filled cells, with replacement (Alg. 5 lines 4 and 7).

        Every offspring has its own generator, so any division of a batch draws the same parents.

        Args:
            archive: Elites to draw from.
            settings: Settings of the run.
            generation: Generation of the offspring.
            first: Place of the first offspring in the batch.
            count: Number of offspring, at least 1.
            each: Parents of each.

        Returns:
            (count, each) int64 array of cells.

        Raises:
            ArchiveError: The archive is empty.
        """
        draws = [
            archive.sample_parents(
                generator(settings.seed, Purpose.PARENTS, generation, place), each
            )
            for place in range(first, first + count)
        ]
        return np.stack(draws)

    def intended(self, operator: Operator, parents: Float64Array) -> Float64Array | None:
        """Return the descriptors that an operator's offspring are meant to achieve.

        What learns from their episodes is told, and offspring are made with networks that are conditioned on them.

        Args:
            operator: What makes the offspring.
            parents: (n, each, d) float64 descriptors of their parents.

        Returns:
            (n, d) float64, None where offspring are meant to achieve nothing in particular.
        """
        return None

    def offered(self, operators: Int64Array) -> BoolArray:
        """Return which solutions are offered to the archive; all count as evaluations.

        Args:
            operators: (n,) values of `Operator`.

        Returns:
            (n,) bool.
        """
        return np.ones(len(operators), np.bool_)

    def exploration_sigma(self, settings: Settings, generation: int) -> float:
        """Return the standard deviation of the noise on all actions of a generation, 0 for none."""
        return 0.0

    def remembered(self, episode: Episode) -> Episode:
        """Return as much of an episode as has to be stored for what is learned from it."""
        return episode
