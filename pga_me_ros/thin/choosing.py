"""Which elites of a repertoire are kept: the best of each part of the region that they cover."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.corrected import NOBODY, corrected_owners
from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.make_archive import thinned_archive
from pga_me_ros.core.archive.spread import spread_cells
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.errors import RequestError

ROUNDS = 8
"""Numbers of cells that are tried: how many of them are filled is known only once they are made."""


MOST_CELLS = 1000
"""Cells above which the descriptor space is not divided evenly: a tessellation of more takes minutes."""


@dataclass(frozen=True)
class Thinning:
    """What is kept.

    Attributes:
        most: Most elites to keep.
        max_fall_share: Greatest share of an elite's re-evaluations that ended in a fall.
        max_spread: Greatest standard deviation of an elite's descriptor, mean over its dimensions, in shares of their
            ranges.
        min_fitness: Least mean fitness of an elite.
    """

    most: int
    max_fall_share: float = math.inf
    max_spread: float = math.inf
    min_fitness: float = -math.inf


def thinned(archive: Archive, known: Statistics, wanted: Thinning) -> Archive:
    """Return an archive of fewer cells that holds, in each of them, the elite with the greatest mean fitness.

    Its cells are a centroidal Voronoi tessellation of the descriptor space, of as many cells as it takes to fill nearly
    as many as are wanted; an elite belongs to the cell of its mean descriptor. Elites that cover a small part of a
    space of many dimensions, such as that of four feet, would need too many cells: then a cell is what lies nearest to
    one of as many elites as are wanted, chosen as far apart as can be.

    Args:
        archive: The archive.
        known: Re-evaluations of its elites.
        wanted: What is kept.

    Raises:
        RequestError: No elite is as steady and as fit as wanted.
    """
    steady = _steady(archive, known, wanted)
    cells = most = min(wanted.most, len(steady.known(archive)))
    coarse = _empty(archive, cells)
    owners = corrected_owners(archive, steady, coarse)
    for _ in range(ROUNDS):
        filled = _count(owners)
        if filled >= 0.95 * most:
            break
        cells = max(cells + 1, int(cells * min(2.0, most / filled)))
        if cells > MOST_CELLS:
            coarse = _around_elites(archive, steady, most)
            owners = corrected_owners(archive, steady, coarse)
            break
        finer = _empty(archive, cells)
        found = corrected_owners(archive, steady, finer)
        if _count(found) > most:  # the coarser ones stay
            break
        coarse, owners = finer, found
    for cell in np.flatnonzero(owners != NOBODY).tolist():
        coarse.put(dataclasses.replace(archive.elite(int(owners[cell])), cell=cell))
    return coarse


def _steady(archive: Archive, known: Statistics, wanted: Thinning) -> Statistics:
    """Return the statistics of those elites that may be kept; of the others, none.

    Raises:
        RequestError: There are none.
    """
    spread = (known.descriptor_spread / archive.extent).mean(axis=1)
    fits = known.repeats > 0
    if wanted.max_fall_share < math.inf:
        fits &= known.fall_share <= wanted.max_fall_share
    if wanted.max_spread < math.inf:
        fits &= spread <= wanted.max_spread
    if wanted.min_fitness > -math.inf:
        fits &= known.mean_fitness >= wanted.min_fitness
    if not (fits & archive.filled).any():
        fittest = np.nanmax(known.mean_fitness)
        raise RequestError(
            "No behavior is as steady and as fit as wanted: the one that falls least does in "
            f"{100.0 * np.nanmin(known.fall_share):.1f} % of its re-evaluations, the least spread of a descriptor "
            f"is {np.nanmin(spread):.3f}, and the greatest mean fitness {fittest:.1f}; allow more."
        )
    return dataclasses.replace(known, repeats=np.where(fits, known.repeats, 0))


def _empty(archive: Archive, cells: int) -> Archive:
    """Return an empty archive of so many cells that covers the same descriptor space."""
    low, high = archive.low.tolist(), archive.high.tolist()
    return thinned_archive(cells, low, high, archive.parameter_count)


def _around_elites(archive: Archive, steady: Statistics, count: int) -> Archive:
    """Return an empty archive whose cells lie around so many of the steady elites, far from each other."""
    elites = steady.as_elites(archive)
    chosen = spread_cells(elites, steady.known(archive), count)
    low, high = archive.low.tolist(), archive.high.tolist()
    return CvtArchive(elites.descriptors[chosen], low, high, archive.parameter_count)


def _count(owners: Int64Array) -> int:
    return int(np.count_nonzero(owners != NOBODY))
