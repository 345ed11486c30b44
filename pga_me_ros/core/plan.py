"""What a generation consists of: pure functions of the settings and the generation's number.

`core.search` (one process) and the orchestrator (many) both follow a `GenerationPlan`, so that they cannot diverge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pga_me_ros.core.algorithms import Slots, algorithm_of
from pga_me_ros.core.evaluation import evaluation_ids
from pga_me_ros.core.exploration import Noise
from pga_me_ros.core.operators import OPERATORS, Operator, needs_snapshot
from pga_me_ros.core.settings import Settings


@dataclass(frozen=True)
class TrainingOrder:
    """What determines a training, besides the critics' state before it.

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
        return cls(generation, experience, settings.rates)

    @property
    def ordered_in(self) -> int:
        """Generation in which the training takes place: the first that is not yet part of its experience."""
        return self.experience + 1


@dataclass(frozen=True)
class GenerationPlan:
    """One generation: which operators make which controllers, and which trainings take place (Alg. 3).

    Attributes:
        generation: Its number t, from 0.
        settings: Settings with the rates in force.
        evaluations: Ids of its evaluations.
        slots: Which operator fills which places of the batch, in order.
        exploration: Noise on the actions of all its episodes.
        training: Training that must end before the offspring that need its snapshot; None if there is none.
        meanwhile: Training for t + 1 that runs while t is evaluated; None if there is none.
        meanwhile_ends_within: Whether `meanwhile` must end before t is added to the archive.
    """

    generation: int
    settings: Settings
    evaluations: range
    slots: tuple[Slots, ...]
    exploration: Noise
    training: TrainingOrder | None
    meanwhile: TrainingOrder | None
    meanwhile_ends_within: bool

    @classmethod
    def of(
        cls, settings: Settings, before: Settings, generation: int, imported: int = 0
    ) -> GenerationPlan:
        """Plan a generation.

        Args:
            settings: Settings with the rates in force.
            before: Settings with the rates that were in force for the generation before.
            generation: Its number.
            imported: Number of controllers that the run starts with instead of random ones.
        """
        algorithm = algorithm_of(settings)
        return cls(
            generation=generation,
            settings=settings,
            evaluations=evaluation_ids(settings, generation),
            slots=tuple(algorithm.batch_plan(settings, generation, imported)),
            exploration=algorithm.exploration(settings, generation),
            training=training_for(settings, before, generation),
            meanwhile=training_meanwhile(settings, generation),
            # The run's first training may start the greedy controller at the present best elite, so it could not be
            # repeated later; and a run must not end during a training.
            meanwhile_ends_within=generation < settings.init_generations
            or generation + 1 >= settings.generations,
        )

    @property
    def unlearned(self) -> tuple[Slots, ...]:
        """Places whose offspring need no snapshot, and so can be evaluated while the critics still train."""
        return tuple(s for s in self.slots if not needs_snapshot(s.operator, self.generation))

    @property
    def learned(self) -> tuple[Slots, ...]:
        """Places whose offspring are made with the snapshot of this generation."""
        return tuple(s for s in self.slots if needs_snapshot(s.operator, self.generation))


def batch_lines(settings: Settings, imported: int = 0) -> list[str]:
    """Return lines that say which operators make how many controllers, and a warning if critics are never used.

    Args:
        settings: Settings with the rates in force.
        imported: Number of controllers that the run starts with instead of random ones.
    """
    algorithm = algorithm_of(settings)
    slots = algorithm.batch_plan(settings, max(settings.init_generations, 1), imported)
    made = ", ".join(f"{s.count} {OPERATORS[s.operator].title}" for s in slots)
    first = f"{settings.random_init - imported} random"
    if imported:
        first = f"{imported} imported, {first}"
    lines = [f"{algorithm.title}: {first} controllers first, then batches of {made}"]
    if Operator.PG in algorithm.operators and not algorithm.uses_critics(settings):
        lines.append(
            f"warning: n_evo is {settings.n_evo}, all of a batch, so no offspring are made by policy gradients; lower "
            "n_evo, or use algorithm:=map_elites"
        )
    return lines


def training_meanwhile(settings: Settings, generation: int) -> TrainingOrder | None:
    """Return the training that runs while a generation is evaluated, None if there is none."""
    if not algorithm_of(settings).trains_meanwhile(settings, generation):
        return None
    return TrainingOrder.of(generation + 1, generation - 1, settings)


def training_for(settings: Settings, before: Settings, generation: int) -> TrainingOrder | None:
    """Return the training that must end before a generation does, None if there is none.

    It is the one that was started while the generation before was evaluated, even if this one's rates use no
    gradients: a later training continues from it. If there was none, it is the one that this generation's offspring
    need.

    Args:
        settings: Settings with the rates in force for this generation.
        before: Settings with the rates that were in force for the generation before.
        generation: Number of the generation.
    """
    under_way = training_meanwhile(before, generation - 1)
    if under_way is None and algorithm_of(settings).needs_snapshot(settings, generation):
        return TrainingOrder.of(generation, generation - 1, settings)
    return under_way
