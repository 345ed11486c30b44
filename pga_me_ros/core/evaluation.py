"""One evaluation: its id, its initial pose, and the noise on its actions, as functions of the settings and its id."""

from __future__ import annotations

import numpy as np

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.exploration import Act, exploring
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings


def as_evaluated(settings: Settings, controller: Act, evaluation: int) -> Act:
    """Return a controller as it acted, or will act, in an evaluation of a run.

    Args:
        settings: Settings of the run.
        controller: The controller of that evaluation, see `exploring`.
        evaluation: Id of the evaluation.
    """
    generation = evaluation // settings.batch_size
    noise = algorithm_of(settings).exploration(settings, generation)
    return exploring(controller, noise, settings.seed, evaluation)


def evaluation_ids(settings: Settings, generation: int) -> range:
    """Return the evaluation ids of a generation: whole batches, counted from 0."""
    return range(generation * settings.batch_size, (generation + 1) * settings.batch_size)


def reevaluation_rng(seed: int, repeat: int) -> np.random.Generator:
    """Return the generator of the initial pose of a re-evaluation.

    All controllers begin a repeat in the same pose, so that what differs between them is their own doing.
    """
    return generator(seed, Purpose.REEVALUATION, 0, repeat)


def evaluation_rng(seed: int, evaluation: int) -> np.random.Generator:
    """Return the generator of one evaluation's initial pose; ids are unique, so it needs no generation."""
    return generator(seed, Purpose.EVALUATION, 0, evaluation)
