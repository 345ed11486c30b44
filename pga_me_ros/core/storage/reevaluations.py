"""What elites did when they were evaluated again from other initial poses: a file of its own next to the repertoire.

An elite owes its place to one evaluation, in which it may have been lucky. The mean of several tells what a robot may
expect; its difference to the one fitness is the "fitness difference" of Nilsson & Cully (2021).
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elite_table import EliteTable
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.storage.npz import load_arrays, save_arrays
from pga_me_ros.errors import StorageError

FILE = "reevaluations.npz"
"""Name of the file in the folder of the repertoire."""

FORMAT = "pga_me_ros reevaluations 1"


def reevaluation_rng(seed: int, repeat: int) -> np.random.Generator:
    """Return the generator of the initial pose of a repeat.

    All controllers begin a repeat in the same pose, so that what differs between them is their own doing.
    """
    return generator(seed, Purpose.REEVALUATION, 0, repeat)


@dataclass(frozen=True)
class Statistics:
    """Mean and spread of the re-evaluations of each cell's elite.

    Attributes:
        repeats: (cells,) int64 re-evaluations of the elite, 0 for none.
        mean_fitness: (cells,) float64, NaN where there is none.
        fitness_spread: (cells,) float64 sample standard deviation, NaN for fewer than two.
        mean_descriptor: (cells, d) float64, NaN where there is none.
        descriptor_spread: (cells, d) float64 sample standard deviation, NaN for fewer than two.
    """

    repeats: Int64Array
    mean_fitness: Float64Array
    fitness_spread: Float64Array
    mean_descriptor: Float64Array
    descriptor_spread: Float64Array

    def as_elites(self, archive: Archive) -> EliteTable:
        """Return elites as their means tell them; those that were not re-evaluated are left out.

        Args:
            archive: The archive that the statistics are of.

        Returns:
            A view with fitness and descriptors replaced by means, for choosing cells. An elite's mean descriptor may
            lie in another cell than its own.
        """
        view = copy.copy(archive)
        view.filled = archive.filled & (self.repeats > 0)
        view.fitness = self.mean_fitness
        view.descriptors = self.mean_descriptor
        return view


@dataclass(frozen=True)
class Reevaluations:
    """All re-evaluations of a run's elites, one row each.

    Attributes:
        run_id: Run that the elites are of.
        evaluation: (m,) int64 evaluation ids of the elites.
        repeat: (m,) int64 number of the repeat, from 0; it gives the initial pose.
        fitness: (m,) float64.
        descriptor: (m, d) float64.
        steps: (m,) int64 lengths of the episodes, control steps.
        terminated: (m,) bool, whether the robot fell.
    """

    run_id: str
    evaluation: Int64Array
    repeat: Int64Array
    fitness: Float64Array
    descriptor: Float64Array
    steps: Int64Array
    terminated: BoolArray

    @classmethod
    def none(cls, run_id: str, dimensions: int) -> Reevaluations:
        """Return none yet."""
        ints, floats = np.empty(0, np.int64), np.empty(0)
        descriptor = np.empty((0, dimensions))
        return cls(run_id, ints, ints, floats, descriptor, ints, np.empty(0, np.bool_))

    @classmethod
    def load(cls, repertoire: Path, run_id: str, dimensions: int) -> Reevaluations:
        """Read those next to a repertoire file; none if there is no file of re-evaluations.

        Args:
            repertoire: The repertoire file.
            run_id: Its run.
            dimensions: Its number d of descriptor dimensions.

        Raises:
            StorageError: The file is damaged, or of another run.
        """
        path = repertoire.with_name(FILE)
        if not path.exists():
            return cls.none(run_id, dimensions)
        arrays = load_arrays(path, FORMAT, "file of re-evaluations")
        if str(arrays.get("run_id", "")) != run_id:
            raise StorageError(
                f"'{path}' is of run {arrays.get('run_id', 'unknown')}, but the repertoire next to it is of run "
                f"{run_id}; move the file away and run reevaluate again."
            )
        try:
            rows = cls(run_id, *(arrays[f.name] for f in fields(cls)[1:]))
        except KeyError as error:
            raise StorageError(f"'{path}' lacks the array {error}; run reevaluate anew.") from None
        rows._check(path, dimensions)
        return rows

    def save(self, repertoire: Path) -> None:
        """Write them next to a repertoire file, in place of earlier ones.

        Raises:
            StorageError: The file cannot be written.
        """
        arrays = {f.name: np.asarray(getattr(self, f.name)) for f in fields(self)}
        save_arrays(repertoire.with_name(FILE), {"format": np.array(FORMAT), **arrays})

    def with_more(self, more: Reevaluations) -> Reevaluations:
        """Return these and others of the same run."""
        names = [f.name for f in fields(self)[1:]]
        joined = [np.concatenate([getattr(self, n), getattr(more, n)]) for n in names]
        return Reevaluations(self.run_id, *joined)

    def missing(self, evaluations: Int64Array, repeats: int) -> list[tuple[int, int]]:
        """Return (evaluation, repeat) of all repeats 0..repeats-1 of the given elites that are missing."""
        there = set(zip(self.evaluation.tolist(), self.repeat.tolist(), strict=True))
        wanted = [(e, r) for e in evaluations.tolist() for r in range(repeats)]
        return [pair for pair in wanted if pair not in there]

    def statistics(self, archive: Archive) -> Statistics:
        """Return mean and spread for each cell's elite; rows of elites that were replaced meanwhile do not count."""
        cell_of = {int(archive.evaluations[c]): c for c in archive.filled_cells().tolist()}
        cells = np.array([cell_of.get(e, -1) for e in self.evaluation.tolist()], np.int64)
        # Sums depend on their order: sorted rows give the same bits however the repeats came in.
        order = np.lexsort((self.repeat, cells))
        order = order[cells[order] >= 0]
        filled, starts = np.unique(cells[order], return_index=True)
        size, d = archive.cells, archive.dimensions
        out = Statistics(
            np.zeros(size, np.int64),
            np.full(size, np.nan),
            np.full(size, np.nan),
            np.full((size, d), np.nan),
            np.full((size, d), np.nan),
        )
        for cell, rows in zip(filled.tolist(), np.split(order, starts[1:]), strict=False):
            fitness, descriptor = self.fitness[rows], self.descriptor[rows]
            out.repeats[cell] = len(rows)
            out.mean_fitness[cell] = fitness.mean()
            out.mean_descriptor[cell] = descriptor.mean(axis=0)
            if len(rows) > 1:
                out.fitness_spread[cell] = fitness.std(ddof=1)
                out.descriptor_spread[cell] = descriptor.std(axis=0, ddof=1)
        return out

    def _check(self, path: Path, dimensions: int) -> None:
        """Raise if the arrays of a file do not fit together."""
        count = self.evaluation.size
        shapes: dict[str, tuple[int, ...]] = {
            "evaluation": (count,),
            "repeat": (count,),
            "fitness": (count,),
        }
        shapes |= {"descriptor": (count, dimensions), "steps": (count,), "terminated": (count,)}
        for name, shape in shapes.items():
            values = getattr(self, name)
            kind = "f" if name in ("fitness", "descriptor") else "iub"
            if values.shape != shape or values.dtype.kind not in kind:
                raise StorageError(
                    f"'{path}': array '{name}' is {values.dtype} of the shape {values.shape}; expected {shape}. "
                    "Move the file away and run reevaluate again."
                )
        if not (np.isfinite(self.fitness).all() and np.isfinite(self.descriptor).all()):
            raise StorageError(f"'{path}' holds numbers that are not finite; run reevaluate anew.")


REPEATS = 10
"""Evaluations that the single one is compared with."""


def fitness_differences(
    metrics: Sequence[Metrics], rows: Reevaluations, repeats: int = REPEATS
) -> Float64Array:
    """Return, for every generation, the best elite's fitness minus the mean of its re-evaluations.

    The repeats 0 to `repeats` - 1 count and no others, so that all runs are measured alike.

    Args:
        metrics: Metrics of every generation.
        rows: Re-evaluations of the controllers that were the best ones (``reevaluate RUN --bests``).
        repeats: Number of re-evaluations per controller.

    Returns:
        (generations,) float64; NaN where the best one is not known or was not re-evaluated as often.
    """
    found: dict[int, dict[int, float]] = {}
    for evaluation, repeat, fitness in zip(
        rows.evaluation.tolist(), rows.repeat.tolist(), rows.fitness.tolist(), strict=True
    ):
        if repeat < repeats:
            found.setdefault(evaluation, {})[repeat] = fitness
    means = {
        evaluation: math.fsum(fitness.values()) / repeats
        for evaluation, fitness in found.items()
        if len(fitness) == repeats
    }
    return np.array(
        [m.max_fitness - means.get(m.best_evaluation, math.nan) for m in metrics], np.float64
    )
