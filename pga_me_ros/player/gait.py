"""The behavior that is played, from a served repertoire or a file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from pga_me_ros.arrays import Float64Array


class Gait(Protocol):
    """A behavior to play; both `pga_me_ros.client.Behavior` and `StoredBehavior` implement it."""

    @property
    def cell(self) -> int:
        """Its cell in the archive."""

    @property
    def evaluation(self) -> int:
        """Id of its original evaluation."""

    @property
    def fitness(self) -> float:
        """Its fitness in that evaluation."""

    @property
    def descriptor(self) -> Float64Array:
        """(d,) float64 descriptor in that evaluation."""

    @property
    def by_mean(self) -> bool:
        """Whether it was chosen by the means of its re-evaluations."""

    @property
    def repeats(self) -> int:
        """Number of its re-evaluations."""

    @property
    def fitness_spread(self) -> float:
        """Standard deviation of their fitness, NaN for fewer than two."""

    @property
    def fall_share(self) -> float:
        """Share of them that ended in a fall, NaN for none."""

    @property
    def promised_fitness(self) -> float:
        """The fitness that it was chosen by."""

    @property
    def promised_descriptor(self) -> Float64Array:
        """(d,) float64 descriptor that it was chosen by."""

    @property
    def distance(self) -> float:
        """Distance from its descriptor to the requested one, 0 if none was requested."""

    @property
    def controller(self) -> Callable[[Any], Any]:
        """Maps an observation, (observation_dim,) float32, to an action, (action_dim,) float32."""
