"""What the loop of generations asks of the system that it carries out: pure functions of settings and generation.

`core.search` (one process) and the orchestrator (many) both ask, so that they cannot drift apart.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.elites import Operator
from pga_me_ros.core.errors import SettingsError
from pga_me_ros.core.rng import Purpose, generator

if (
    TYPE_CHECKING
):  # settings ask the systems what fits; learners bring torch along, which light processes lack
    from pga_me_ros.core.archive import Archive
    from pga_me_ros.core.learns import Learns
    from pga_me_ros.core.settings import Settings
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


class System(ABC):
    """One of the systems that section 4.2 compares; instances have no state.

    What most of them have in common is here: random controllers first, no critics, every solution offered, parents
    drawn uniformly.

    Attributes:
        name: Value of the setting `algorithm`.
        title: Name for people, as in the paper.
        defaults: Values that it has in place of the defaults of `Settings`.
        parents: The operators that make its offspring, random controllers apart, and how many parents each takes.
        learns_critics: Whether what it learns, if it learns anything, is critics.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    defaults: ClassVar[Mapping[str, Any]] = {}
    parents: ClassVar[Mapping[Operator, int]] = {Operator.GA: 2, Operator.PG: 1}
    learns_critics: ClassVar[bool] = True

    def own_values(self, settings: Settings) -> Mapping[str, Any]:
        """Return the values that it has in place of the defaults of `Settings`.

        Args:
            settings: All of them, each checked by itself; those with a value of their own not yet put in.
        """
        return self.defaults

    def check(self, settings: Settings, given: Mapping[str, Any]) -> None:
        """Make sure that settings do not ask for what the system is not.

        Args:
            settings: All of them, with the system's own defaults.
            given: Those that differ from the defaults of `Settings`.

        Raises:
            SettingsError: They do.
        """
        if settings.batch_size < 2:
            raise SettingsError(
                f"batch_size is {settings.batch_size}; {self.name} needs at least 2 controllers per generation."
            )

    def check_task(self, spec: TaskSpec) -> None:  # noqa: B027 - most systems take every task
        """Make sure that a task offers what the system needs beyond what every task has.

        Raises:
            TaskError: It does not.
        """

    def batch_plan(self, settings: Settings, generation: int, imported: int = 0) -> list[Slots]:
        """Return which operator fills which places of a generation's batch.

        Imported and then random controllers in the first ceil(G / b) generations, what `offspring` says afterwards.

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
            plan = self.offspring(settings, generation)
        return [slots for slots in plan if slots.count]

    @abstractmethod
    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Return the plan of a generation after the random ones; empty slots are left out by the caller."""

    def uses_critics(self, settings: Settings) -> bool:
        """Whether anything is learned at all, with the rates in force."""
        return False

    def needs_snapshot(self, settings: Settings, generation: int) -> bool:
        """Whether this generation cannot be made without what was learned for it."""
        return generation >= settings.init_generations and self.uses_critics(settings)

    def trains_meanwhile(self, settings: Settings, generation: int) -> bool:
        """Whether training for the next generation goes on while this one is evaluated.

        It is then on the experience up to ``generation - 1``. Otherwise each generation's training takes place before
        the generation is made, on all experience there is.
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
    ) -> NDArray[np.int64]:
        """Draw parents uniformly over filled cells, with replacement (Alg. 5 lines 4 and 7).

        Every offspring has a generator of its own, so any division of a batch draws the same parents.

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

    def offered(self, operators: NDArray[np.int64]) -> NDArray[np.bool_]:
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

    def make_learner(self, spec: TaskSpec, settings: Settings, workers: int = 1) -> Learns:
        """Return what learns from experience, and makes a snapshot of it for each generation.

        Args:
            spec: Task.
            settings: Settings of the run.
            workers: Threads of training.

        Raises:
            SettingsError: The device cannot be used here.
            PgaError: The machine cannot reserve memory for `replay_size` transitions.
        """
        from pga_me_ros.core.learner import Learner

        return Learner(spec, settings, workers)
