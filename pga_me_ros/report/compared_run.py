"""A run in a comparison: its metrics of section 4.4 (Nilsson & Cully 2021) at every generation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.corrected import corrected_archive
from pga_me_ros.core.storage.reevaluations import fitness_differences
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.tasks.spec import TaskSpec

Curve = Float64Array


def common_grid(evaluations: Sequence[Curve], last: float) -> Curve:
    """Return where curves of several runs are drawn: wherever a generation of one of them ends.

    Runs of other batch sizes end their generations after other numbers of evaluations, so a median over generations
    would mix them.

    Args:
        evaluations: (generations,) evaluations after each generation, of each run.
        last: Number of evaluations to end at.

    Returns:
        (n,) float64 numbers of evaluations, ascending.
    """
    grid = np.unique(np.concatenate(evaluations))
    return grid[grid <= last]


def values_at(evaluations: Curve, values: Curve, asked: Curve) -> Curve:
    """Return a metric after given numbers of evaluations: its value at the last generation within each.

    Args:
        evaluations: (generations,) evaluations after each generation, ascending.
        values: (generations,) the metric after each.
        asked: (n,) numbers of evaluations.

    Returns:
        (n,) float64, NaN before the end of the first generation.
    """
    places = np.searchsorted(evaluations, asked, side="right") - 1
    return np.where(places < 0, np.nan, values[np.maximum(places, 0)])


def _corrected_curves(run: StoredRun) -> dict[str, Curve]:
    """Return metrics from re-evaluations, NaN except at generations whose archive was re-evaluated."""
    sources = {"qd_score": "corrected_qd_score", "coverage": "corrected_coverage"}
    sources |= {"fall_share": "fall_share"}
    curves = {name: np.full(len(run.generations), np.nan) for name in sources.values()}
    for measured in run.reevaluations.measured:
        for source, name in sources.items():
            if measured.generation < len(run.generations):
                curves[name][measured.generation] = getattr(measured.corrected, source)
    return curves


@dataclass(frozen=True)
class ComparedRun:
    """A run without its archive, since hundreds of archives would not fit into memory.

    Attributes:
        system: Name of the system.
        algorithm: The run's algorithm.
        spec: Task.
        seed: Seed of the run.
        file: Its repertoire file.
        evaluations: (generations,) float64 evaluations after each generation.
        lowest_fitness: Lowest fitness of an elite in any of its generations.
        curves: (generations,) float64 each: qd_score (without offset), coverage, max_fitness, fitness_difference,
            corrected_qd_score (without offset), corrected_coverage and fall_share; NaN where unknown.
    """

    system: str
    algorithm: str
    spec: TaskSpec
    seed: int
    file: Path
    evaluations: Curve
    lowest_fitness: float
    curves: Mapping[str, Curve]

    @classmethod
    def load(cls, path: Path, system: str = "") -> ComparedRun:
        """Read a run.

        Args:
            path: Folder of the run, or its repertoire file.
            system: Name of the system; empty for the run's `algorithm`.

        Raises:
            StorageError: There is no run, it is damaged, or it has no generation yet.
            RequestError: It is a thinned repertoire, without the generations that led to it.
        """
        run = StoredRun.load(path, elites=False)
        metrics = run.metrics
        if not metrics:
            raise StorageError(f"'{run.file}' holds no behavior yet; run it for longer first.")
        if run.is_thinned:
            raise RequestError(
                f"'{run.file}' is thinned: it has a part of a run's elites and no generations to compare; give the "
                "whole run, or report on it without --compare."
            )
        lowest = run.curve("min_fitness")
        if np.isnan(lowest).any():  # older versions don't store it: use the final archive, too
            lowest = np.append(lowest, run.archive.min_fitness)
        names = ("qd_score", "coverage", "max_fitness")
        curves = {n: run.curve(n) for n in names}
        differences = fitness_differences(metrics, run.reevaluations)
        return cls(
            system=system or run.settings.algorithm,
            algorithm=run.settings.algorithm,
            spec=run.spec,
            seed=run.settings.seed,
            file=run.file,
            evaluations=run.curve("evaluations"),
            lowest_fitness=float(np.nanmin(lowest)),
            curves={**curves, "fitness_difference": differences, **_corrected_curves(run)},
        )

    @property
    def is_corrected(self) -> bool:
        """Whether all elites of its last generation were re-evaluated."""
        return bool(np.isfinite(self.curves["corrected_qd_score"][-1]))

    def load_archive(self, *, corrected: bool = False) -> Archive:
        """Return the archive after the last generation.

        Args:
            corrected: Whether to return the corrected archive, from re-evaluations of its elites.

        Raises:
            StorageError: The run is damaged.
        """
        run = StoredRun.load(self.file)
        return corrected_archive(run.archive, run.statistics) if corrected else run.archive

    def at(self, evaluations: Curve, metric: str, offset: float) -> Curve:
        """Return a metric after given numbers of evaluations: its value at the last generation within each.

        Args:
            evaluations: (n,) numbers of evaluations.
            metric: A key of `curves`.
            offset: Fitness that QD-scores are measured from.

        Returns:
            (n,) float64, NaN before the end of the first generation.
        """
        values = self.curves[metric]
        if metric.endswith("qd_score"):
            values = values - offset * self.curves[metric.replace("qd_score", "coverage")]
        return values_at(self.evaluations, values, evaluations)
