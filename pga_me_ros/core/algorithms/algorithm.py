"""The interface between the generation loop and an algorithm: pure functions of settings and generation.

`core.search` (one process) and the orchestrator (many) both use it through `core.plan`, so they cannot drift apart.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.exploration import QUIET, Noise
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
        count: Number of places.
    """

    operator: Operator
    first: int
    count: int


def without_extraction(settings: Settings) -> Settings:
    """Return the settings with the batch reduced by the solutions that are re-evaluated in it.

    A number of GA offspring that is not the algorithm's own shrinks in proportion, and leaves a place for other kinds
    if it did before.
    """
    if not settings.extracted:
        return settings
    left = settings.batch_size - settings.extracted
    changes: dict[str, Any] = {"batch_size": left, "extract_share": 0.0, "cell_depth": 1}
    n_evo, b = settings.n_evo, settings.batch_size
    # By value, not by whether it was given: a run that resumes is given all rates, and must plan as it did before.
    if n_evo == settings.replace(n_evo=Settings.n_evo).n_evo:
        changes["n_evo"] = Settings.n_evo
    else:
        changes["n_evo"] = min(round(n_evo * left / b), left - (n_evo < b))
    return settings.replace(**changes)


class Algorithm(ABC):
    """An algorithm that fills an archive; instances have no state.

    The defaults are what most algorithms share: random controllers first, no critics, every solution offered to the
    archive, parents drawn uniformly. Defaults and limits of its settings are in `core.settings.rules`, its learner in
    `learners`.

    Attributes:
        name: Value of the setting `algorithm`.
        title: Display name, as in the paper.
        operators: Operators that make its offspring, after the random or imported controllers at the start.
        learns_critics: Whether it learns critics; it may learn something else, or nothing.
        conditioned: Whether its critics and its actor are conditioned on a descriptor.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    operators: ClassVar[tuple[Operator, ...]]
    learns_critics: ClassVar[bool] = True
    conditioned: ClassVar[bool] = False

    def check_task(self, spec: TaskSpec) -> None:  # noqa: B027 - most algorithms take every task
        """Check that a task meets the algorithm's requirements beyond the task protocol.

        Raises:
            TaskError: The task does not meet them.
        """

    def batch_plan(self, settings: Settings, generation: int, imported: int = 0) -> list[Slots]:
        """Return which operator fills which places of a generation's batch.

        The first ceil(G / b) generations are imported controllers, then random ones. Later generations follow
        `offspring`; the last places of a batch may re-evaluate elites of the archive (Extract-MAP-Elites).

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
        """Whether anything is learned with the rates in force."""
        return False

    def snapshot_networks(self, spec: TaskSpec, settings: Settings) -> Mapping[str, MlpShape]:
        """Return the shape of each network in the algorithm's snapshots, by name.

        Args:
            spec: Task of the run.
            settings: Settings of the run.
        """
        return {CRITIC: critic_shape(spec, settings), GREEDY: controller_shape(spec, settings)}

    def needs_snapshot(self, settings: Settings, generation: int) -> bool:
        """Whether this generation's offspring are made with a snapshot."""
        return generation >= settings.init_generations and self.uses_critics(settings)

    def trains_meanwhile(self, settings: Settings, generation: int) -> bool:
        """Whether the next generation's training overlaps with the evaluation of this one.

        If so, it uses the experience up to ``generation - 1``. Otherwise each generation's training takes place before
        its offspring are made, on all experience so far.
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
            each: Parents per offspring.

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

        Descriptor-conditioned networks make offspring for these descriptors and learn from their episodes with them.

        Args:
            operator: Operator that makes the offspring.
            parents: (n, each, d) float64 descriptors of their parents.

        Returns:
            (n, d) float64; None if offspring have no intended descriptor.
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

    def exploration(self, settings: Settings, generation: int) -> Noise:
        """Return the exploration noise on a generation's actions."""
        return QUIET

    def remembered(self, episode: Episode) -> Episode:
        """Return the part of an episode that learning needs and that is stored."""
        return episode
