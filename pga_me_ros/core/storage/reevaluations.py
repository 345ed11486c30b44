"""What elites did when they were re-evaluated from other initial poses: a file of its own next to the repertoire.

An elite owes its place to one evaluation, in which it may have been lucky. The mean of several tells what a robot may
expect; its difference to the one fitness is the "fitness difference" of Nilsson & Cully (2021).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.corrected import CorrectedMetrics
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.storage.npz import load_arrays, save_arrays
from pga_me_ros.errors import StorageError

FILE = "reevaluations.npz"
"""Name of the file in the folder of the repertoire."""

MOST_REPEATS = 10_000
"""Most re-evaluations of an elite."""

FORMAT = "pga_me_ros reevaluations 1"

_ELSEWHERE = "reevaluations-*.npz"
"""Names of the files of re-evaluations in which other things were randomized than in the run."""


def file_name(elsewhere: str | None = None) -> str:
    """Return the name of a file of re-evaluations.

    Args:
        elsewhere: What was randomized, where that was something else than in the run; None for the run's own.
    """
    if elsewhere is None:
        return FILE
    return _ELSEWHERE.replace("*", hashlib.sha256(elsewhere.encode()).hexdigest()[:8])


_ROWS = ("evaluation", "repeat", "fitness", "descriptor", "steps", "terminated")
"""Arrays with one row per re-evaluation, in the order of the fields of `Reevaluations`."""

_MEASURE = "measured_"
"""Begins the names of the arrays with one entry per measured archive; files of older versions lack them."""


@dataclass(frozen=True)
class RepeatOutcome:
    """Outcome of one re-evaluation; attributes as in `Reevaluations`, one row."""

    evaluation: int
    repeat: int
    fitness: float
    descriptor: Float64Array
    steps: int
    terminated: bool


@dataclass(frozen=True)
class Measured:
    """What the elites that there were after a generation turned out to be worth.

    Attributes:
        generation: The generation.
        corrected: Measures of all of its elites.
    """

    generation: int
    corrected: CorrectedMetrics


@dataclass(frozen=True)
class Reevaluations:
    """All re-evaluations of a run's elites, one row each, and what was measured by them.

    Attributes:
        run_id: Run that the elites are of.
        evaluation: (m,) int64 evaluation ids of the elites.
        repeat: (m,) int64 number of the repeat, from 0; it gives the initial pose.
        fitness: (m,) float64.
        descriptor: (m, d) float64.
        steps: (m,) int64 lengths of the episodes, control steps.
        terminated: (m,) bool, whether the robot fell.
        elsewhere: What was randomized, where that was something else than in the run (`Settings.randomization`); None
            in the run's own world. Each has a file of its own.
        measured: Measures of whole archives, by generation, ascending. Rows of elites that were replaced since tell of
            them no more, so they are kept.
    """

    run_id: str
    evaluation: Int64Array
    repeat: Int64Array
    fitness: Float64Array
    descriptor: Float64Array
    steps: Int64Array
    terminated: BoolArray
    measured: tuple[Measured, ...] = ()
    elsewhere: str | None = None

    @classmethod
    def none(cls, run_id: str, dimensions: int, elsewhere: str | None = None) -> Reevaluations:
        """Return none yet."""
        ints, floats = np.empty(0, np.int64), np.empty(0)
        columns = (ints, ints, floats, np.empty((0, dimensions)), ints, np.empty(0, np.bool_))
        return cls(run_id, *columns, elsewhere=elsewhere)

    @classmethod
    def load(
        cls, repertoire: Path, run_id: str, dimensions: int, elsewhere: str | None = None
    ) -> Reevaluations:
        """Read those next to a repertoire file; none if there is no file of re-evaluations.

        Args:
            repertoire: The repertoire file.
            run_id: Its run.
            dimensions: Its number d of descriptor dimensions.
            elsewhere: What was randomized, as in `file_name`.

        Raises:
            StorageError: The file is damaged, or of another run.
        """
        path = repertoire.with_name(file_name(elsewhere))
        if not path.exists():
            return cls.none(run_id, dimensions, elsewhere)
        arrays = load_arrays(path, FORMAT, "file of re-evaluations")
        if str(arrays.get("run_id", "")) != run_id:
            raise StorageError(
                f"'{path}' is of run {arrays.get('run_id', 'unknown')}, but the repertoire next to it is of run "
                f"{run_id}; move the file away and run reevaluate again."
            )
        try:
            columns: Any = {name: arrays[name] for name in _ROWS}
            rows = cls(run_id, **columns, measured=_measured_from(arrays), elsewhere=elsewhere)
        except KeyError as error:
            raise StorageError(f"'{path}' lacks the array {error}; run reevaluate anew.") from None
        except (TypeError, ValueError) as error:
            raise StorageError(
                f"'{path}' holds measures that cannot be read ({error}); run reevaluate anew."
            ) from None
        rows._check(path, dimensions)
        return rows

    @classmethod
    def load_elsewhere(
        cls, repertoire: Path, run_id: str, dimensions: int
    ) -> tuple[Reevaluations, ...]:
        """Read all those next to a repertoire file in which other things were randomized than in the run.

        Raises:
            StorageError: A file is damaged, or of another run.
        """
        found = []
        for path in sorted(repertoire.parent.glob(_ELSEWHERE)):
            text = str(load_arrays(path, FORMAT, "file of re-evaluations").get("elsewhere", ""))
            found.append(cls.load(repertoire, run_id, dimensions, text))
        return tuple(found)

    def save(self, repertoire: Path) -> None:
        """Write them next to a repertoire file, in place of earlier ones.

        Raises:
            StorageError: The file cannot be written.
        """
        arrays = {name: np.asarray(getattr(self, name)) for name in ("run_id", *_ROWS)}
        arrays |= _measured_arrays(self.measured)
        if self.elsewhere is not None:
            arrays["elsewhere"] = np.array(self.elsewhere)
        path = repertoire.with_name(file_name(self.elsewhere))
        save_arrays(path, {"format": np.array(FORMAT), **arrays})

    def with_more(self, outcomes: Sequence[RepeatOutcome]) -> Reevaluations:
        """Return these and further ones behind them, in an order that does not depend on which came in first.

        Args:
            outcomes: Outcomes that are not among the rows yet.
        """
        if not outcomes:
            return self
        more = sorted(outcomes, key=lambda o: (o.evaluation, o.repeat))
        columns: dict[str, Any] = {}
        for name in _ROWS:
            values = getattr(self, name)
            new = np.array([getattr(o, name) for o in more], values.dtype)
            columns[name] = np.concatenate([values, new])
        return replace(self, **columns)

    def with_measure(self, generation: int, corrected: CorrectedMetrics) -> Reevaluations:
        """Return these with the measures of the archive after a generation, in place of earlier ones of it."""
        others = [m for m in self.measured if m.generation != generation]
        measured = sorted([*others, Measured(generation, corrected)], key=lambda m: m.generation)
        return replace(self, measured=tuple(measured))

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
        out = Statistics.none(archive.cells, archive.dimensions)
        for cell, rows in zip(filled.tolist(), np.split(order, starts[1:]), strict=False):
            fitness, descriptor = self.fitness[rows], self.descriptor[rows]
            out.repeats[cell] = len(rows)
            out.mean_fitness[cell] = fitness.mean()
            out.mean_descriptor[cell] = descriptor.mean(axis=0)
            out.fall_share[cell] = np.count_nonzero(self.terminated[rows]) / len(rows)
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


def _measured_arrays(measured: Sequence[Measured]) -> dict[str, NDArray[Any]]:
    """Return measures as arrays, one entry per measured archive; none if there is none."""
    if not measured:
        return {}
    arrays = {f"{_MEASURE}generation": np.array([m.generation for m in measured], np.int64)}
    for f in fields(CorrectedMetrics):
        arrays[_MEASURE + f.name] = np.array([getattr(m.corrected, f.name) for m in measured])
    return arrays


def _measured_from(arrays: Mapping[str, NDArray[Any]]) -> tuple[Measured, ...]:
    """Return what `_measured_arrays` made arrays of.

    Raises:
        KeyError: Some of the arrays are missing, though not all.
        ValueError: They are of different lengths.
    """
    generations = arrays.get(f"{_MEASURE}generation", np.empty(0, np.int64))
    if not generations.size:
        return ()
    names = [f.name for f in fields(CorrectedMetrics)]
    columns = [arrays[_MEASURE + name].tolist() for name in names]
    return tuple(
        Measured(generation, CorrectedMetrics(**dict(zip(names, values, strict=True))))
        for generation, *values in zip(generations.tolist(), *columns, strict=True)
    )


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
