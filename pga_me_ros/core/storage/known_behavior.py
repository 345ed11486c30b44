"""What is known of a behavior, be it stored or served."""

from __future__ import annotations

from pga_me_ros.arrays import Float64Array


class KnownBehavior:
    """Base of stored and served behaviors, which are dataclasses and describe their fields."""

    cell: int
    evaluation: int
    fitness: float
    descriptor: Float64Array
    repeats: int
    mean_fitness: float
    fitness_spread: float
    mean_descriptor: Float64Array
    descriptor_spread: Float64Array
    fall_share: float
    by_mean: bool

    @property
    def promised_fitness(self) -> float:
        """The fitness that it was chosen by: the mean of its re-evaluations, or that of its one evaluation."""
        return self.mean_fitness if self.by_mean else self.fitness

    @property
    def promised_descriptor(self) -> Float64Array:
        """(d,) float64 the descriptor that it was chosen by, as `promised_fitness`."""
        return self.mean_descriptor if self.by_mean else self.descriptor
