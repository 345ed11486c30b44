"""Who makes which offspring, and when the critics train on what: pure functions of settings and generation.

`core.search` (one process) and the orchestrator (many) both follow these, so that they cannot drift apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.elite_table import EliteTable
from pga_me_ros.core.elites import Operator
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import RATES, Settings


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


def batch_plan(settings: Settings, generation: int, imported: int = 0) -> list[Slots]:
    """Return which operator fills which places of a generation's batch (Alg. 3 lines 9-13, Alg. 5).

    Imported and then random controllers in the first ceil(G / b) generations; afterwards the greedy controller, then
    GA, then PG offspring. With n_evo = b there are no gradients and so no greedy controller: standard MAP-Elites.

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
        return [slots for slots in plan if slots.count]
    if not uses_critics(settings):
        return [Slots(Operator.GA, 0, b)]
    taken = 1 if settings.greedy_takes == "ga" else 0
    n_ga = min(max(settings.n_evo - taken, 0), b - 1)
    plan = [
        Slots(Operator.GREEDY, 0, 1),
        Slots(Operator.GA, 1, n_ga),
        Slots(Operator.PG, 1 + n_ga, b - 1 - n_ga),
    ]
    return [slots for slots in plan if slots.count]


def uses_critics(settings: Settings) -> bool:
    """Whether the rates in force call for gradients at all."""
    return settings.n_evo < settings.batch_size


def needs_snapshot(settings: Settings, generation: int) -> bool:
    """Whether this generation cannot be made without critics trained for it."""
    return generation >= settings.init_generations and uses_critics(settings)


def trains_meanwhile(settings: Settings, generation: int) -> bool:
    """Whether critics train for the next generation while this one is evaluated.

    They then train on the experience up to ``generation - 1``, so there has to be some.
    """
    first = settings.init_generations - (settings.critic_start == "last_init_batch")
    return (
        settings.schedule == "overlapped" and uses_critics(settings) and generation >= max(first, 1)
    )


@dataclass(frozen=True)
class TrainingOrder:
    """What a training is determined by, beside the critics' state before it.

    Attributes:
        generation: Generation whose offspring the critics are trained for.
        experience: Newest generation whose experience they train on.
        rates: Rates in force, by name.
    """

    generation: int
    experience: int
    rates: dict[str, Any]

    @classmethod
    def of(cls, generation: int, experience: int, settings: Settings) -> TrainingOrder:
        """Make an order from settings with the rates in force."""
        return cls(generation, experience, {name: getattr(settings, name) for name in RATES})

    @property
    def ordered_in(self) -> int:
        """Generation in which the training takes place: the first that is not yet part of its experience."""
        return self.experience + 1


def training_meanwhile(settings: Settings, generation: int) -> TrainingOrder | None:
    """Return the training that goes on while a generation is evaluated, None if there is none."""
    if not trains_meanwhile(settings, generation):
        return None
    return TrainingOrder.of(generation + 1, generation - 1, settings)


def must_end_within(settings: Settings, generation: int) -> bool:
    """Whether the training that goes on meanwhile has to end before this generation is added to the archive.

    The run's first training may start the greedy controller at the best elite of the archive as it is now, and
    so could not be repeated with the archive of the next generation; and a run does not end with a training under way.
    """
    return generation < settings.init_generations or generation + 1 >= settings.generations


def training_for(settings: Settings, before: Settings, generation: int) -> TrainingOrder | None:
    """Return the training that has to be over before a generation is, None if there is none.

    It is the one that was started while the generation before was evaluated, even if this one's rates call for no
    gradients: a later training starts from where it ended. Else it is the one that this generation's offspring need.

    Args:
        settings: Settings with the rates in force for this generation.
        before: Settings with the rates that were in force for the generation before.
        generation: Number of the generation.
    """
    under_way = training_meanwhile(before, generation - 1)
    if under_way is None and needs_snapshot(settings, generation):
        return TrainingOrder.of(generation, generation - 1, settings)
    return under_way


def evaluation_ids(settings: Settings, generation: int) -> range:
    """Return the evaluation ids of a generation: whole batches, counted from 0."""
    return range(generation * settings.batch_size, (generation + 1) * settings.batch_size)


def evaluation_rng(seed: int, evaluation: int) -> np.random.Generator:
    """Return the generator of one evaluation's initial pose; ids are unique, so it needs no generation."""
    return generator(seed, Purpose.EVALUATION, 0, evaluation)


def sample_parents(
    archive: EliteTable, seed: int, generation: int, first: int, count: int, each: int
) -> NDArray[np.int64]:
    """Draw parents uniformly over filled cells, with replacement (Alg. 5 lines 4 and 7).

    Every offspring has a generator of its own, so any division of a batch draws the same parents.

    Args:
        archive: Elites to draw from.
        seed: Seed of the run.
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
        archive.sample_parents(generator(seed, Purpose.PARENTS, generation, place), each)
        for place in range(first, first + count)
    ]
    return np.stack(draws)
