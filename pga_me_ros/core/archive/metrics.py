"""What a generation achieved (section 4.4, Nilsson & Cully 2021), and how much of it each operator did."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pga_me_ros.core.archive.archive import AddResult, Archive
from pga_me_ros.core.archive.elites import Solutions, Status
from pga_me_ros.core.operators import Operator

UNKNOWN = -1
"""Evaluation id of the best elite if it is unknown."""

PER_OPERATOR = ("offspring", "new_elites", "improved_elites")
"""Metrics that have a count per operator."""


@dataclass(frozen=True)
class Metrics:
    """State of the archive after a generation, and what the generation added.

    Counts per operator are in the order of `Operator`: random, ga, pg, greedy, imported, and so on. An operator that is
    newer than a stored file counts 0.

    Attributes:
        generation: Number of the generation, from 0.
        evaluations: Evaluations so far.
        coverage: Filled cells.
        coverage_share: Filled share of all cells, 0 to 1.
        qd_score: Sum of the elites' fitness, without offset.
        max_fitness: Fitness of the best elite.
        mean_fitness: Mean fitness of the elites.
        steps: Control steps simulated in this generation.
        total_steps: Control steps simulated so far.
        offspring: Solutions evaluated in this generation, per operator.
        new_elites: Solutions that filled an empty cell, per operator.
        improved_elites: Solutions that replaced an elite, per operator.
        min_fitness: Fitness of the worst elite; NaN in files of older versions.
        best_evaluation: Evaluation id of the best elite. Ties go to the one found first, so that it changes only when
            the best fitness does. -1 in files of older versions.
    """

    generation: int
    evaluations: int
    coverage: int
    coverage_share: float
    qd_score: float
    max_fitness: float
    mean_fitness: float
    steps: int
    total_steps: int
    offspring: tuple[int, ...]
    new_elites: tuple[int, ...]
    improved_elites: tuple[int, ...]
    min_fitness: float = math.nan
    best_evaluation: int = UNKNOWN

    def __post_init__(self) -> None:
        """Give every operator its count."""
        for name in PER_OPERATOR:
            counts = getattr(self, name)
            filled_up = (*counts, *(0,) * (len(Operator) - len(counts)))
            object.__setattr__(self, name, filled_up)


def generation_metrics(
    archive: Archive, batch: Solutions, added: AddResult, generation: int, before: Metrics | None
) -> Metrics:
    """Return the metrics of a generation.

    Args:
        archive: Archive after the generation's batch was added.
        batch: The solutions of the generation.
        added: What `Archive.add` returned for them.
        generation: Number of the generation, from 0.
        before: Metrics of the generation before, None for the first.
    """
    steps = int(batch.steps.sum())
    return Metrics(
        generation=generation,
        evaluations=len(batch) + (before.evaluations if before else 0),
        coverage=archive.coverage,
        coverage_share=archive.coverage / archive.cells,
        qd_score=archive.qd_score(),
        max_fitness=archive.max_fitness,
        mean_fitness=archive.mean_fitness,
        steps=steps,
        total_steps=steps + (before.total_steps if before else 0),
        offspring=_per_operator(batch, np.ones(len(batch), np.bool_)),
        new_elites=_per_operator(batch, added.status == Status.NEW),
        improved_elites=_per_operator(batch, added.status == Status.IMPROVED),
        min_fitness=archive.min_fitness,
        best_evaluation=_best_evaluation(archive, before),
    )


def _best_evaluation(archive: Archive, before: Metrics | None) -> int:
    """Return the evaluation id of the best elite; only a fitter one replaces that of the generation before."""
    if not len(archive):
        return UNKNOWN
    cells = archive.filled_cells()
    fittest = cells[archive.fitness[cells] == archive.max_fitness]
    # It may have been taken out of the archive, or have another estimate: only what is there counts.
    if before is not None and before.best_evaluation in archive.evaluations[fittest]:
        return before.best_evaluation
    return int(archive.evaluations[fittest].min())


def _per_operator(batch: Solutions, chosen: np.ndarray) -> tuple[int, ...]:
    counts = np.bincount(batch.operators[chosen], minlength=max(Operator) + 1)
    return tuple(counts[list(Operator)].tolist())
