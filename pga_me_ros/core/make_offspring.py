"""Offspring of every operator: what `core.search` and the variation node both call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.elites import Operator
from pga_me_ros.core.errors import RequestError
from pga_me_ros.core.offspring import es_samples, ga_offspring, pg_states, random_controllers
from pga_me_ros.core.pg_variation import pg_variation
from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.systems import system_of

Float32Array = NDArray[np.float32]


@dataclass(frozen=True)
class Wanted:
    """Offspring for consecutive places of a batch, and all that they depend on.

    Attributes:
        settings: Settings with the rates in force.
        shape: Layers of the controllers.
        generation: Their generation.
        first: Place of the first one in the batch.
        count: How many, at least 1.
        parents: (count, each, P) float32 parameters, as many each as the operator takes.
        snapshot: What was learned for their generation; None for an operator that does not need it.
        workers: Threads; no result depends on their number.
    """

    settings: Settings
    shape: MlpShape
    generation: int
    first: int
    count: int
    parents: Float32Array
    snapshot: Snapshot | None = None
    workers: int = 1


def make_offspring(operator: Operator, wanted: Wanted) -> Float32Array:
    """Return (count, P) float32 parameters of an operator's offspring.

    Args:
        operator: One of `MAKERS`.
        wanted: What to make.

    Raises:
        NetworkError: A parent does not fit the layers.
        RequestError: The snapshot has not what the operator needs.
    """
    return MAKERS[operator](wanted)


def _random(w: Wanted) -> Float32Array:
    return random_controllers(w.settings, w.shape, w.generation, w.first, w.count)


def _ga(w: Wanted) -> Float32Array:
    return ga_offspring(w.settings, w.shape, w.generation, w.first, w.parents)


def _pg(w: Wanted) -> Float32Array:
    assert w.snapshot is not None
    return _climb(w, w.snapshot, w.snapshot.critic)


def _diversity(w: Wanted) -> Float32Array:
    assert w.snapshot is not None
    assert w.snapshot.diversity_critic is not None
    return _climb(w, w.snapshot, w.snapshot.diversity_critic)


def _climb(w: Wanted, snapshot: Snapshot, critic: Float32Array) -> Float32Array:
    if snapshot.critic_shape is None:
        raise RequestError(
            f"PG offspring are asked for, but {w.settings.algorithm} learns no critics."
        )
    return pg_variation(
        w.parents[:, 0],
        critic,
        pg_states(snapshot, w.first, w.count),
        w.settings.pg_learning_rate,
        w.shape,
        snapshot.critic_shape,
        threads=w.settings.torch_threads,
        device=w.settings.device,
        workers=w.workers,
    )


def _es_sample(w: Wanted) -> Float32Array:
    if system_of(w.settings).learns_critics:
        raise RequestError(
            f"Samples of an evolution strategy are asked for, but {w.settings.algorithm} has none."
        )
    if w.generation == 0:
        center = random_controllers(w.settings, w.shape, 0, 0, 1)[0]
    else:
        assert w.snapshot is not None
        assert w.snapshot.center is not None
        center = w.snapshot.center
    return es_samples(w.settings, center, w.generation, w.first, w.count)


MAKERS: dict[Operator, Callable[[Wanted], Float32Array]] = {
    Operator.RANDOM: _random,
    Operator.GA: _ga,
    Operator.PG: _pg,
    Operator.ES_SAMPLE: _es_sample,
    Operator.QUALITY: _pg,
    Operator.DIVERSITY: _diversity,
}
"""What makes the offspring of each operator; the greedy controller and imported ones are not made but there."""

OF_CRITICS = frozenset({Operator.PG, Operator.QUALITY, Operator.DIVERSITY})
"""Operators that climb a critic."""


def needs_snapshot(operator: Operator, generation: int) -> bool:
    """Whether an operator's offspring depend on what was learned for their generation."""
    return operator in OF_CRITICS or (operator == Operator.ES_SAMPLE and generation > 0)
