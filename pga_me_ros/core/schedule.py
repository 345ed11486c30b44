"""When critics train on what, and which evaluation is which: pure functions of settings and generation.

`core.search` (one process) and the orchestrator (many) both follow these, so that they cannot drift apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.systems import system_of


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
    if not system_of(settings).trains_meanwhile(settings, generation):
        return None
    return TrainingOrder.of(generation + 1, generation - 1, settings)


def training_for(settings: Settings, before: Settings, generation: int) -> TrainingOrder | None:
    """Return the training that a generation's offspring need, None if they need none.

    Args:
        settings: Settings with the rates in force for this generation.
        before: Settings with the rates that were in force for the generation before.
        generation: Number of the generation.
    """
    if not system_of(settings).needs_snapshot(settings, generation):
        return None
    meanwhile = training_meanwhile(before, generation - 1)
    return meanwhile or TrainingOrder.of(generation, generation - 1, settings)


def evaluation_ids(settings: Settings, generation: int) -> range:
    """Return the evaluation ids of a generation: whole batches, counted from 0."""
    return range(generation * settings.batch_size, (generation + 1) * settings.batch_size)


def evaluation_rng(seed: int, evaluation: int) -> np.random.Generator:
    """Return the generator of one evaluation's initial pose; ids are unique, so it needs no generation."""
    return generator(seed, Purpose.EVALUATION, 0, evaluation)
