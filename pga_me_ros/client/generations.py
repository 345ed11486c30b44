"""Generations of a run as plain values, read from the repertoire's messages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pga_me_msgs.msg import Metrics
from pga_me_msgs.srv import ListGenerations

from pga_me_ros.errors import NetworkError

PER_OPERATOR = ("offspring", "new_elites", "improved_elites")
"""Fields of the response that have an entry per generation and operator."""

CORRECTED = "corrected_"
"""What the names of the fields begin with that are known by re-evaluations."""


@dataclass(frozen=True)
class ListedGeneration:
    """State of the archive after a generation, and what the generation added.

    Counts per operator have the operators that made anything.

    Attributes:
        generation: Number of the generation, from 0.
        evaluations: Evaluations so far.
        coverage: Filled cells.
        qd_score: Sum of the elites' fitness.
        max_fitness: Fitness of the best elite.
        mean_fitness: Mean fitness of the elites.
        steps: Control steps simulated in this generation.
        offspring: Solutions evaluated in this generation, by operator.
        new_elites: How many of them filled an empty cell, by operator.
        improved_elites: How many of them replaced an elite, by operator.
        corrected: Measures by re-evaluations of the elites that there were after this generation, by the name of their
            field in `Metrics.msg` without ``corrected_``; empty if not all were re-evaluated.
    """

    generation: int
    evaluations: int
    coverage: int
    qd_score: float
    max_fitness: float
    mean_fitness: float
    steps: int
    offspring: Mapping[str, int]
    new_elites: Mapping[str, int]
    improved_elites: Mapping[str, int]
    corrected: Mapping[str, float]

    @classmethod
    def from_response(cls, response: ListGenerations.Response) -> tuple[ListedGeneration, ...]:
        """Return the generations in a response.

        Raises:
            NetworkError: A field does not have an entry per generation and operator.
        """
        rows, labels = len(response.generations), list(response.operators)
        for name in PER_OPERATOR:
            if len(getattr(response, name)) != rows * len(labels):
                raise NetworkError(
                    f"The answer has {len(getattr(response, name))} entries in {name} for {rows} generations and "
                    f"{len(labels)} operators; the message is malformed."
                )
        return tuple(cls._row(response, i, labels) for i in range(rows))

    @classmethod
    def _row(
        cls, response: ListGenerations.Response, i: int, labels: list[str]
    ) -> ListedGeneration:
        row = slice(i * len(labels), (i + 1) * len(labels))
        made = response.offspring[row]
        counts = {
            name: {
                label: count
                for label, count, any_made in zip(
                    labels, getattr(response, name)[row], made, strict=True
                )
                if any_made
            }
            for name in PER_OPERATOR
        }
        msg = response.generations[i]
        return cls(
            generation=msg.generation,
            evaluations=msg.evaluations,
            coverage=msg.coverage,
            qd_score=msg.qd_score,
            max_fitness=msg.max_fitness,
            mean_fitness=msg.mean_fitness,
            steps=msg.steps,
            **counts,
            corrected=_corrected(msg),
        )


def _corrected(msg: Metrics) -> dict[str, float]:
    if not msg.corrected_repeats:
        return {}
    fields = [name for name in msg.get_fields_and_field_types() if name.startswith(CORRECTED)]
    return {name.removeprefix(CORRECTED): getattr(msg, name) for name in fields}
