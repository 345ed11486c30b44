"""A behavior of a stored run, ready to run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.archive.choosing import Choices
from pga_me_ros.core.archive.elites import NO_PARENT
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.known_behavior import KnownBehavior


@dataclass(frozen=True, eq=False)
class StoredBehavior(KnownBehavior):
    """An elite of a stored run.

    Attributes:
        cell: Its cell in the archive.
        evaluation: Id of the evaluation that fitness and descriptor are from.
        fitness: Sum of rewards in that evaluation.
        descriptor: (d,) float64 achieved descriptor.
        distance: Euclidean distance from the descriptor that was asked for, 0 if none was.
        generation: Generation that it was made in.
        made_by: Operator that made it, for example ``pg``.
        parents: Evaluation ids of its parents, at most two.
        steps: Length of that evaluation, control steps.
        terminated: Whether that evaluation ended by a fall.
        repeats: Re-evaluations from other initial poses, 0 for none.
        mean_fitness: Mean of their fitness, NaN for none.
        fitness_spread: Sample standard deviation of their fitness, NaN for fewer than two.
        mean_descriptor: (d,) float64 mean of their descriptors, NaN for none.
        descriptor_spread: (d,) float64 sample standard deviation of each entry, NaN for fewer than two.
        fall_share: Share of them that ended in a fall, NaN for none.
        by_mean: Whether it was judged by these means when it was chosen, rather than by its one evaluation.
        parameters: (P,) float32; per layer the weights (out, in) row by row, then the biases.
        controller: Maps an observation, (observation_dim,) float32, to an action, (action_dim,) float32 within ±1.
    """

    cell: int
    evaluation: int
    fitness: float
    descriptor: Float64Array
    distance: float
    generation: int
    made_by: str
    parents: tuple[int, ...]
    steps: int
    terminated: bool
    repeats: int
    mean_fitness: float
    fitness_spread: float
    mean_descriptor: Float64Array
    descriptor_spread: Float64Array
    fall_share: float
    by_mean: bool
    parameters: Float32Array
    controller: Callable[[Float32Array], Float32Array]

    @classmethod
    def chosen(
        cls, choices: Choices, cell: int, shape: MlpShape, distance: float = 0.0
    ) -> StoredBehavior:
        """Return the behavior of a cell.

        Args:
            choices: What it was chosen from.
            cell: Its cell.
            shape: Layers of the controllers.
            distance: Its distance to the descriptor that was asked for.

        Raises:
            ArchiveError: There is no such cell, or it is empty.
        """
        elite, known = choices.archive.elite(cell), choices.known
        return cls(
            cell=elite.cell,
            evaluation=elite.evaluation,
            fitness=elite.fitness,
            descriptor=elite.descriptor,
            distance=distance,
            generation=elite.generation,
            made_by=elite.operator.label,
            parents=tuple(p for p in (elite.parent1, elite.parent2) if p != NO_PARENT),
            steps=elite.steps,
            terminated=elite.terminated,
            repeats=int(known.repeats[cell]),
            mean_fitness=float(known.mean_fitness[cell]),
            fitness_spread=float(known.fitness_spread[cell]),
            mean_descriptor=known.mean_descriptor[cell].copy(),
            descriptor_spread=known.descriptor_spread[cell].copy(),
            fall_share=float(known.fall_share[cell]),
            by_mean=choices.by_mean(cell),
            parameters=elite.parameters,
            controller=MlpController(shape, elite.parameters),
        )
