"""What is shown: a behavior of a repertoire, served or read from a file."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from pga_me_ros.arrays import Float64Array


class Gait(Protocol):
    """A behavior to show: a `pga_me_ros.client.Behavior` is one, and so is a `StoredBehavior`."""

    @property
    def cell(self) -> int:
        """Its cell in the archive."""

    @property
    def evaluation(self) -> int:
        """Id of the evaluation that the promise comes from."""

    @property
    def fitness(self) -> float:
        """Promised fitness."""

    @property
    def descriptor(self) -> Float64Array:
        """(d,) float64 promised descriptor."""

    @property
    def distance(self) -> float:
        """From its descriptor to the one that was asked for, 0 if none was."""

    @property
    def controller(self) -> Callable[[Any], Any]:
        """Maps an observation, (observation_dim,) float32, to an action, (action_dim,) float32."""
