"""An archive as the repertoire's services tell of it: its cells made anew, its elites from their answers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.client import ListedBehavior, RepertoireInfo
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.grid import ON_EDGE, GridArchive
from pga_me_ros.core.archive.make_archive import cvt_archive, thinned_archive
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import PgaError
from pga_me_ros.tasks.registry import task_spec
from pga_me_ros.tasks.spec import TaskSpec

NO_PARAMETERS = 1
"""Parameters of a controller in these archives, which hold none."""


def spec_of(info: RepertoireInfo, settings: Settings) -> tuple[TaskSpec, str]:
    """Return the spec of a served run's task, and why it is not the one that is known here, empty if it is.

    Of a task that is unknown here, or another one here, it has what the services tell.
    """
    names = tuple(info.descriptor_names)
    low, high = tuple(info.descriptor_low.tolist()), tuple(info.descriptor_high.tolist())
    try:
        known = task_spec(settings.task)
    except PgaError:  # unknown, or of a package that is not installed
        why = f"task '{info.task}' is unknown on this machine"
    else:
        own = known.descriptor_names, known.descriptor_low, known.descriptor_high
        if own == (names, low, high):
            return known, ""
        why = f"task '{info.task}' has another descriptor on this machine"
    spec = TaskSpec(
        name=info.task,
        observation_names=("unknown",),
        observation_units=("",),
        action_names=("unknown",),
        action_units=("",),
        action_low=(-1.0,),
        action_high=(1.0,),
        descriptor_names=names,
        descriptor_low=low,
        descriptor_high=high,
        max_steps=1,
        control_period=1.0,
        archive_cells=info.cells,
        archive_bins=(1,) * len(names),
    )
    return spec, why


def served_archive(
    info: RepertoireInfo, spec: TaskSpec, settings: Settings, behaviors: Sequence[ListedBehavior]
) -> tuple[Archive, Statistics, str]:
    """Return an archive with all but the controllers, what is known of its elites, and what is to be said of its cells.

    Args:
        info: The served repertoire.
        spec: Its task, see `spec_of`.
        settings: Settings of its run.
        behaviors: Its behaviors.
    """
    archive, note = _empty_archive(info, spec, settings, behaviors)
    known = Statistics.none(archive.cells, archive.dimensions)
    labels = {operator.label: int(operator) for operator in Operator}
    for behavior in behaviors:
        cell = behavior.cell
        archive.filled[cell] = True
        archive.fitness[cell] = behavior.fitness
        archive.descriptors[cell] = behavior.descriptor
        archive.evaluations[cell] = behavior.evaluation
        archive.generations[cell] = behavior.generation
        archive.operators[cell] = labels.get(behavior.made_by, 0)
        archive.parents[cell, : len(behavior.parents)] = behavior.parents
        archive.steps[cell] = behavior.steps
        archive.terminated[cell] = behavior.terminated
        known.repeats[cell] = behavior.repeats
        known.mean_fitness[cell] = behavior.mean_fitness
        known.fitness_spread[cell] = behavior.fitness_spread
        known.fall_share[cell] = behavior.fall_share
        for row, values in (
            (known.mean_descriptor, behavior.mean_descriptor),
            (known.descriptor_spread, behavior.descriptor_spread),
        ):
            row[cell] = values if len(values) else np.nan
    return archive, known, note


def _empty_archive(
    info: RepertoireInfo, spec: TaskSpec, settings: Settings, behaviors: Sequence[ListedBehavior]
) -> tuple[Archive, str]:
    """Return the served cells, made anew, and what is to be said of them.

    No service tells the cells, but the behaviors show which are the served ones. In an archive that `thin` has made,
    some lie outside their cells, as re-evaluations that came later have moved their means.
    """
    best, misplaced, note = None, math.inf, ""
    for archive, said in _possible(info, spec, settings, behaviors):
        outside = int(np.count_nonzero(~_in_their_cells(archive, behaviors)))
        if outside < misplaced:
            best, misplaced, note = archive, outside, said
        if not outside:
            break
    assert best is not None
    if 2 * misplaced > len(behaviors):
        note = (
            f"its cells are not known here, so {misplaced} of its gaits are drawn in a wrong place"
        )
    return best, note


def _possible(
    info: RepertoireInfo, spec: TaskSpec, settings: Settings, behaviors: Sequence[ListedBehavior]
) -> Iterator[tuple[Archive, str]]:
    """Yield archives that the served one may be, and what is to be said of each."""
    low, high = spec.descriptor_low, spec.descriptor_high
    if info.archive != GridArchive.kind:
        if info.cells <= settings.cvt_samples:
            yield cvt_archive(info.cells, low, high, settings.cvt_samples, NO_PARAMETERS), ""
        yield thinned_archive(info.cells, low, high, NO_PARAMETERS), ""
        return
    if math.prod(spec.archive_bins) == info.cells:
        yield GridArchive(spec.archive_bins, low, high, NO_PARAMETERS), ""
    bins = grid_bins(info, behaviors)
    archive = GridArchive(bins, low, high, NO_PARAMETERS)
    yield archive, f"drawn as a grid of {' x '.join(map(str, bins))} bins, which its gaits fit"


def _in_their_cells(archive: Archive, behaviors: Sequence[ListedBehavior]) -> BoolArray:
    """Return of each behavior whether its cell holds its descriptor, or as in thinned archives the mean one."""
    cells = np.array([b.cell for b in behaviors], np.int64)
    found = np.stack([b.descriptor for b in behaviors])
    mean = np.stack([b.mean_descriptor if b.repeats else b.descriptor for b in behaviors])
    return (archive.cell_of(found) == cells) | (archive.cell_of(mean) == cells)


def grid_bins(info: RepertoireInfo, behaviors: Sequence[ListedBehavior]) -> tuple[int, ...]:
    """Return bins of a grid that has each behavior in its cell.

    Where several grids fit, as they may while there are few behaviors, or none does, it is the one whose bins differ
    least between the dimensions.
    """
    low, high = info.descriptor_low, info.descriptor_high
    shares = (np.stack([b.descriptor for b in behaviors]) - low) / (high - low)
    cells = np.array([b.cell for b in behaviors], np.int64)
    fitting = list(_fitting(info.cells, np.clip(shares, 0.0, 1.0), cells))
    any_at_all = np.empty((0, len(low))), np.empty(0, np.int64)
    return min(fitting or _fitting(info.cells, *any_at_all), key=lambda bins: max(bins) / min(bins))


def _fitting(count: int, shares: Float64Array, cells: Int64Array) -> Iterator[tuple[int, ...]]:
    """Yield all bins of so many cells in which (n, d) shares of the range are in their (n,) cells."""
    last = shares.shape[1] == 1
    for bins in [count] if last else range(1, count + 1):
        if count % bins:
            continue
        own = np.minimum(np.floor(bins * shares[:, -1] + ON_EDGE), bins - 1)
        if not np.array_equal(own, cells % bins):
            continue
        if last:
            yield (bins,)
        else:
            for outer in _fitting(count // bins, shares[:, :-1], cells // bins):
                yield (*outer, bins)
