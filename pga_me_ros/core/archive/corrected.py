"""What an archive is worth once its elites were re-evaluated: the measures of Flageat & Cully (2023).

Flageat & Cully, *Uncertain Quality-Diversity: Evaluation methodology and new methods for Quality-Diversity in Uncertain
Domains* (arXiv 2302.00463): the **corrected archive** takes all elites into an empty archive by the means of their
re-evaluations; corrected coverage and corrected QD-score are its own. **Reproducibility** is how much fitness and
descriptor of the same elite vary from one re-evaluation to the next: the smaller, the better.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.statistics import Statistics

NOBODY = -1
"""Entry of `corrected_owners` for a cell that is empty in the corrected archive."""


@dataclass(frozen=True)
class CorrectedMetrics:
    """Measures of an archive's elites over their re-evaluations.

    Means over elites give every elite the same weight.

    Attributes:
        elites: Elites that were re-evaluated.
        repeats: Re-evaluations of the elite that has the fewest.
        reevaluations: Re-evaluations of all elites together.
        coverage: Filled cells of the corrected archive.
        qd_score: Sum of the mean fitness of its elites, without offset.
        max_fitness: Greatest mean fitness.
        mean_fitness: Mean over elites of their mean fitness.
        fitness_difference: Mean over elites of the fitness that they were found with minus their mean fitness: how much
            of it was luck.
        descriptor_error: Mean over elites of the distance between the descriptor that they were found with and their
            mean descriptor, each dimension in shares of its range.
        fitness_spread: Reproducibility of fitness: mean over elites of the standard deviation of their fitness; NaN
            where an elite has fewer than two re-evaluations.
        descriptor_spread: Reproducibility of the descriptor: mean over elites and dimensions of its standard deviation,
            in shares of the dimension's range; NaN where an elite has fewer than two re-evaluations.
        fall_share: Mean over elites of the share of their re-evaluations that ended in a fall.
    """

    elites: int
    repeats: int
    reevaluations: int
    coverage: int
    qd_score: float
    max_fitness: float
    mean_fitness: float
    fitness_difference: float
    descriptor_error: float
    fitness_spread: float
    descriptor_spread: float
    fall_share: float


def corrected_owners(
    archive: Archive, known: Statistics, into: Archive | None = None
) -> Int64Array:
    """Return which elite holds each cell of the corrected archive.

    Elites are added in the order of their own cells, and strictly fitter ones replace, as in `Archive.add`.

    Args:
        archive: The archive.
        known: Re-evaluations of its elites.
        into: An archive whose cells the corrected one has, None for those of `archive`; its elites do not matter.

    Returns:
        (cells,) int64 array: the cell that the elite has in `archive`, `NOBODY` where the corrected archive is empty.
    """
    target = archive if into is None else into
    owners = np.full(target.cells, NOBODY, np.int64)
    elites = known.known(archive)
    if not len(elites):
        return owners
    for elite, cell in zip(
        elites.tolist(), target.cell_of(known.mean_descriptor[elites]).tolist(), strict=True
    ):
        owner = owners[cell]
        if owner == NOBODY or known.mean_fitness[elite] > known.mean_fitness[owner]:
            owners[cell] = elite
    return owners


def corrected_archive(archive: Archive, known: Statistics) -> Archive:
    """Return the corrected archive: elites in the cells of their mean descriptors, with their mean fitness.

    Args:
        archive: The archive.
        known: Re-evaluations of its elites.

    Returns:
        A view for measuring and drawing; of its arrays, only `filled`, `fitness`, `descriptors` and `evaluations` are
        those of the corrected archive.
    """
    return _view(archive, known, corrected_owners(archive, known))


def steady_archive(archive: Archive, known: Statistics, most: float) -> Archive:
    """Return the corrected archive without the elites that fall often.

    Args:
        archive: The archive.
        known: Re-evaluations of its elites.
        most: Greatest share of its re-evaluations in which an elite that stays may fall.

    Returns:
        A view as that of `corrected_archive`.
    """
    owners = corrected_owners(archive, known)
    return _view(archive, known, np.where(known.fall_share[owners] <= most, owners, NOBODY))


def _view(archive: Archive, known: Statistics, owners: Int64Array) -> Archive:
    """Return the corrected archive whose cells have these owners, see `corrected_owners`."""
    filled = owners != NOBODY
    view = copy.copy(archive)
    view.filled = filled
    view.fitness = np.where(filled, known.mean_fitness[owners], np.nan)
    view.descriptors = np.where(filled[:, None], known.mean_descriptor[owners], np.nan)
    view.evaluations = np.where(filled, archive.evaluations[owners], NOBODY)
    return view


def corrected_metrics(archive: Archive, known: Statistics) -> CorrectedMetrics | None:
    """Return the measures of an archive's elites.

    Args:
        archive: The archive.
        known: Re-evaluations of its elites.

    Returns:
        The measures of the elites that were re-evaluated, None if none was.
    """
    cells = known.known(archive)
    if not len(cells):
        return None
    corrected = corrected_archive(archive, known)
    means, repeats = known.mean_fitness[cells], known.repeats[cells]
    moved = (archive.descriptors[cells] - known.mean_descriptor[cells]) / archive.extent
    spread = known.descriptor_spread[cells] / archive.extent
    return CorrectedMetrics(
        elites=len(cells),
        repeats=int(repeats.min()),
        reevaluations=int(repeats.sum()),
        coverage=corrected.coverage,
        qd_score=corrected.qd_score(),
        max_fitness=float(means.max()),
        mean_fitness=_mean(means),
        fitness_difference=_mean(archive.fitness[cells] - means),
        descriptor_error=_mean(np.sqrt((moved**2).sum(axis=1))),
        fitness_spread=_mean(known.fitness_spread[cells]),
        descriptor_spread=_mean(spread.ravel()),
        fall_share=_mean(known.fall_share[cells]),
    )


def complete_metrics(archive: Archive, known: Statistics) -> CorrectedMetrics | None:
    """Return the measures of an archive of which every elite was re-evaluated, else None.

    Only then do they speak of the archive: of a part, corrected coverage and QD-score say nothing.
    """
    measured = corrected_metrics(archive, known)
    return measured if measured and measured.elites == archive.coverage else None


def in_words(measured: CorrectedMetrics, archive: Archive) -> list[str]:
    """Return measures for people, line by line.

    Args:
        measured: Measures of an archive's elites.
        archive: The archive.
    """
    m = measured
    spread = (
        "unknown, since some were re-evaluated only once"
        if m.repeats < 2
        else f"fitness {m.fitness_spread:.1f}, descriptor {m.descriptor_spread:.3f}"
    )
    lines = [
        f"fitness: {m.mean_fitness + m.fitness_difference:.1f} when they were found, {m.mean_fitness:.1f} on average "
        f"since (difference {m.fitness_difference:.1f})",
        f"descriptor: the mean lies {m.descriptor_error:.3f} from the one that they were found with",
        f"reproducibility (standard deviation from one evaluation of an elite to the next): {spread}",
        f"falls: {100.0 * m.fall_share:.1f} % of the episodes",
    ]
    if m.elites == archive.coverage:
        lines.append(
            f"corrected archive: coverage {m.coverage} (not {archive.coverage}), QD-score {m.qd_score:.1f} (not "
            f"{archive.qd_score():.1f}), best fitness {m.max_fitness:.1f} (not {archive.max_fitness:.1f})"
        )
    return lines


def _mean(values: np.ndarray) -> float:
    """Return the mean, exact but for its last rounding, so that it does not depend on an order."""
    return math.fsum(values.tolist()) / len(values)
