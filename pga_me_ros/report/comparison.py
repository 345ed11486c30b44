"""Systems compared on a task: the same metrics at the same number of evaluations, medians and p-values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.experiment.experiment_file import REFERENCE, read_experiment
from pga_me_ros.experiment.plan import COPY
from pga_me_ros.report.compared_run import ComparedRun, Curve, common_grid
from pga_me_ros.tasks.spec import OPTIONAL_FIELDS

METRICS = {
    "qd_score": "QD-score",
    "coverage": "coverage",
    "max_fitness": "max fitness",
    "fitness_difference": "fitness difference",
}
"""Metrics of section 4.4 in the order of Figure 3 (Nilsson & Cully 2021), and their labels."""

CORRECTED = {
    "corrected_qd_score": "corrected QD-score",
    "corrected_coverage": "corrected coverage",
    "fall_share": "falls",
}
"""Metrics from re-evaluations of the last generation's elites (Flageat & Cully 2023), and their labels."""

PERMUTATIONS = 20_000
"""Largest number of permutations for the exact test; beyond it, the normal approximation is good enough."""


@dataclass(frozen=True)
class TaskComparison:
    """Runs of several systems on one task.

    Attributes:
        task: Name of the task.
        systems: Runs by system.
        evaluations: Number of evaluations that all runs have reached.
        offset: Lowest fitness of all runs; QD-scores are measured from it.
    """

    task: str
    systems: dict[str, list[ComparedRun]]
    evaluations: float
    offset: float

    def final(self, system: str, metric: str) -> Curve:
        """Return a metric of a system's runs after `evaluations`: (runs,) float64, without unknown values."""
        at = np.array([self.evaluations])
        values = [run.at(at, metric, self.offset)[0] for run in self.systems[system]]
        return np.array([value for value in values if not math.isnan(value)])

    def curve(self, system: str, metric: str) -> tuple[Curve, Float64Array]:
        """Return evaluations (n,) and the values (runs, n) of a system's runs, NaN where unknown."""
        runs = self.systems[system]
        grid = common_grid([run.evaluations for run in runs], self.evaluations)
        return grid, np.stack([run.at(grid, metric, self.offset) for run in runs])

    def typical(self, system: str) -> ComparedRun:
        """Return the run with the median QD-score; of an even number, the lower of the middle two."""
        runs = self.systems[system]
        at = np.array([self.evaluations])
        scores = [run.at(at, "qd_score", self.offset)[0] for run in runs]
        order = np.argsort(scores, kind="stable")
        return runs[order[(len(runs) - 1) // 2]]


@dataclass(frozen=True)
class Comparison:
    """A comparison of systems on several tasks.

    Attributes:
        tasks: Comparison on each task.
        reference: System that p-values compare with.
        missing: Missing runs, in words.
    """

    tasks: list[TaskComparison]
    reference: str
    missing: list[str]

    @property
    def metrics(self) -> dict[str, str]:
        """Metrics that are known for at least one run, and their labels."""
        known = any(
            len(task.final(system, metric))
            for task in self.tasks
            for system in task.systems
            for metric in CORRECTED
        )
        return METRICS | CORRECTED if known else METRICS


def compare(
    runs: Sequence[ComparedRun], reference: str = REFERENCE, missing: Sequence[str] = ()
) -> Comparison:
    """Sort runs by task and system.

    Args:
        runs: The runs.
        reference: System that p-values compare with.
        missing: Missing runs, in words.

    Raises:
        RequestError: There is no run, a run is given twice, different tasks have the same name, or a run's first
            generation ends later than another run.
    """
    if not runs:
        first = f"; {len(missing)} are missing, the first: {missing[0]}" if missing else ""
        raise RequestError(f"There is no finished run to compare{first}. Run the experiment first.")
    by_task: dict[str, dict[str, list[ComparedRun]]] = {}
    for run in runs:
        own = by_task.setdefault(run.spec.name, {}).setdefault(run.system, [])
        if run.seed in [other.seed for other in own]:
            raise RequestError(
                f"'{run.file}' is a second run of {run.system} on {run.spec.name} with seed {run.seed}; it would count "
                "twice: leave one out."
            )
        own.append(run)
    return Comparison(
        [_task_comparison(task, systems) for task, systems in by_task.items()],
        reference,
        list(missing),
    )


def _task_comparison(task: str, systems: dict[str, list[ComparedRun]]) -> TaskComparison:
    runs = [run for own in systems.values() for run in own]
    # Optional fields only add information, and runs of older versions lack them: ignore them.
    known = [{k: v for k, v in vars(run.spec).items() if k not in OPTIONAL_FIELDS} for run in runs]
    other = next((run for run, own in zip(runs, known, strict=True) if own != known[0]), None)
    if other:
        raise RequestError(
            f"'{other.file}' and '{runs[0].file}' are runs of different tasks that are both called {task}; compare "
            "runs of one version of it."
        )
    shortest = min(runs, key=lambda run: run.evaluations[-1])
    end = shortest.evaluations[-1]
    late = next((run for run in runs if run.evaluations[0] > end), None)
    if late:
        raise RequestError(
            f"The first generation of '{late.file}' ends after {late.evaluations[0]:,.0f} evaluations, but "
            f"'{shortest.file}' as a whole after {end:,.0f}: there is no number to compare both at; leave one out."
        )
    return TaskComparison(
        task,
        systems,
        end,
        min(run.lowest_fitness for run in runs),
    )


def is_experiment(path: Path) -> bool:
    """Whether a path is the folder of an experiment."""
    return (path / COPY).is_file()


def compare_experiment(folder: Path) -> Comparison:
    """Compare the finished runs of an experiment, and list the unfinished ones.

    Raises:
        SettingsError: The experiment file is invalid.
        RequestError: No run is finished.
    """
    experiment = read_experiment(folder / COPY)
    runs, missing = [], []
    for cell in experiment.cells:
        path = cell.folder(folder)
        if not path.exists():
            missing.append(f"{cell.name}: not begun")
            continue
        try:
            run = ComparedRun.load(path, cell.system)
        except StorageError as error:
            missing.append(f"{cell.name}: {error}")
            continue
        if run.evaluations[-1] < experiment.budget:
            missing.append(
                f"{cell.name}: {run.evaluations[-1]:,.0f} of {experiment.budget:,} evaluations"
            )
        else:
            runs.append(run)
    return compare(runs, experiment.reference, missing)


def rank_sum_p(first: Sequence[float] | Curve, second: Sequence[float] | Curve) -> float:
    """Return the two-sided p-value of the Wilcoxon rank-sum test (section 4.4), NaN for an empty sample.

    Exact for small samples, with or without ties: it enumerates all permutations of the ranks and doubles the smaller
    tail. With three runs each, p cannot be below 0.1, since 2 of the 20 ways to split six ranks are the most extreme;
    the normal approximation, which is used for many runs, would give 0.05.

    Args:
        first: Numbers.
        second: Numbers.
    """
    from scipy.stats import mannwhitneyu, rankdata

    n, m = len(first), len(second)
    if not n or not m:
        return math.nan
    if math.comb(n + m, n) > PERMUTATIONS:
        return float(mannwhitneyu(first, second, method="asymptotic").pvalue)
    ranks = rankdata([*first, *second])  # ties share the mean of their ranks
    sums = np.array([sum(dealt) for dealt in combinations(ranks, n)])
    # Ranks are multiples of 0.5, so the sums are exact and can be compared for equality.
    return float(min(1.0, 2 * min(np.mean(sums <= sums[0]), np.mean(sums >= sums[0]))))
