"""Offspring of every operator: what `core.search` and the variation node both call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.networks.conditioned import folded
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import ACTOR, CENTER, CRITIC, DIVERSITY_CRITIC, Snapshot
from pga_me_ros.core.variation.genetic import ga_offspring
from pga_me_ros.core.variation.mirrored_samples import es_samples
from pga_me_ros.core.variation.policy_gradient import pg_states, pg_variation
from pga_me_ros.core.variation.random_controllers import random_controllers


@dataclass(frozen=True)
class OffspringRequest:
    """Offspring for consecutive places of a batch, and everything they depend on.

    Attributes:
        settings: Settings with the rates in force.
        shape: Layers of the controllers.
        generation: Their generation.
        first: Place of the first one in the batch.
        count: Number of offspring, at least 1.
        parents: (count, parents per offspring, P) float32 parameters.
        snapshot: What was learned for their generation; None for an operator that does not need it.
        workers: Threads; no result depends on their number.
        conditions: (count, d) float32 descriptors that the snapshot's networks are conditioned on, scaled to ±1; None
            for networks that are not.
    """

    settings: Settings
    shape: MlpShape
    generation: int
    first: int
    count: int
    parents: Float32Array
    snapshot: Snapshot | None = None
    workers: int = 1
    conditions: Float32Array | None = None


def make_offspring(operator: Operator, wanted: OffspringRequest) -> Float32Array:
    """Return (count, P) float32 parameters of an operator's offspring.

    Args:
        operator: One of `MAKERS`.
        wanted: What to make.

    Raises:
        NetworkError: A parent or a condition does not fit the layers.
        RequestError: The snapshot lacks a network that the operator needs, or has no states for those places.
    """
    return MAKERS[operator](wanted)


def _random(w: OffspringRequest) -> Float32Array:
    return random_controllers(w.settings, w.shape, w.generation, w.first, w.count)


def _ga(w: OffspringRequest) -> Float32Array:
    return ga_offspring(w.settings, w.shape, w.generation, w.first, w.parents)


def _pg(w: OffspringRequest) -> Float32Array:
    return _climb(w, CRITIC)


def _diversity(w: OffspringRequest) -> Float32Array:
    return _climb(w, DIVERSITY_CRITIC)


def _climb(w: OffspringRequest, name: str) -> Float32Array:
    assert w.snapshot is not None
    critic_shape, critic = w.snapshot.network(name)
    if w.conditions is not None:
        critic_shape, critic = folded(critic_shape, critic, w.shape.sizes[0], w.conditions)
    return pg_variation(
        w.parents[:, 0],
        critic,
        pg_states(w.snapshot, w.first, w.count),
        w.settings.pg_learning_rate,
        w.shape,
        critic_shape,
        threads=w.settings.torch_threads,
        device=w.settings.device,
        workers=w.workers,
    )


def _actor_injection(w: OffspringRequest) -> Float32Array:
    assert w.snapshot is not None
    assert w.conditions is not None
    return folded(*w.snapshot.network(ACTOR), w.shape.sizes[0], w.conditions)[1]


def _es_sample(w: OffspringRequest) -> Float32Array:
    if w.generation == 0:
        center = random_controllers(w.settings, w.shape, 0, 0, 1)[0]
    else:
        assert w.snapshot is not None
        center = w.snapshot.parameters(CENTER)
    return es_samples(w.settings, center, w.generation, w.first, w.count)


MAKERS: dict[Operator, Callable[[OffspringRequest], Float32Array]] = {
    Operator.RANDOM: _random,
    Operator.GA: _ga,
    Operator.PG: _pg,
    Operator.ES_SAMPLE: _es_sample,
    Operator.QUALITY: _pg,
    Operator.DIVERSITY: _diversity,
    Operator.ACTOR_INJECTION: _actor_injection,
}
"""Makers by operator. The greedy controller and imported ones have none, as they already exist."""
