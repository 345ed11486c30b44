"""The authors' published medians (Nilsson & Cully 2021), to show with the user's runs; see paper_curves.csv."""

from __future__ import annotations

import csv
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError

FILE = Path(__file__).with_name("paper_curves.csv")

TASKS = {
    "qd_walker": "QDWalker",
    "qd_half_cheetah": "QDHalfCheetah",
    "qd_ant": "QDAnt",
    "qd_hopper": "QDHopper",
}
"""Their names for our tasks."""

SYSTEMS = {
    "pga_map_elites": "PGA-MAP-Elites",
    "map_elites": "MAP-Elites",
    "pg_only": "PGA-MAP-Elites PG only",
    "td3": "TD3 w. archive",
    "map_elites_es": "MAP-Elites-ES",
    "qd_rl": "QD-RL",
}
"""Their names for our algorithms."""

QUANTITIES = {"qd_score": "sum_fitness", "coverage": "coverage", "max_fitness": "max_fitness"}
"""Their names for our metrics; our QD-score has no offset, except in a comparison."""

LABEL = "authors' median of 20 seeds"


def curves_beside(algorithms: Iterable[str]) -> list[str]:
    """Return whose curves belong under those of algorithms: their own, or of PGA-MAP-Elites if there are none."""
    return [name for name in algorithms if name in SYSTEMS] or ["pga_map_elites"]


@dataclass(frozen=True)
class PaperCurve:
    """Published medians of one algorithm on one task.

    Attributes:
        evaluations: (n,) float64, ascending.
        median: (n,) float64.
        plus_minus: (n,) float64 error of reading the medians off a figure, 0 for those from a table.
    """

    evaluations: Float64Array
    median: Float64Array
    plus_minus: Float64Array

    def until(self, evaluations: float) -> PaperCurve:
        """Return the curve up to a number of evaluations, interpolated at the end."""
        inside = self.evaluations <= evaluations
        at = self.evaluations[inside]
        if len(at) == len(self.evaluations) or (len(at) and at[-1] == evaluations) or not len(at):
            return PaperCurve(at, self.median[inside], self.plus_minus[inside])
        end = np.interp(evaluations, self.evaluations, self.median)
        return PaperCurve(
            np.append(at, evaluations),
            np.append(self.median[inside], end),
            np.append(self.plus_minus[inside], np.nan),
        )


def paper_curve(task: str, algorithm: str, metric: str, offset: float = 0.0) -> PaperCurve | None:
    """Return the authors' published curve.

    Args:
        task: Name of the task, for example ``qd_hopper``.
        algorithm: Value of the setting `algorithm`.
        metric: ``qd_score``, ``coverage`` or ``max_fitness``.
        offset: Fitness that QD-scores are measured from.

    Returns:
        The curve, None if they published none.
    """
    own = TASKS.get(task), SYSTEMS.get(algorithm), QUANTITIES.get(metric)
    curve = _curves().get(own)
    if curve is None or metric != "qd_score" or not offset:
        return curve
    cells = _curves()[own[0], own[1], "coverage"]
    filled = np.interp(curve.evaluations, cells.evaluations, cells.median)
    return PaperCurve(curve.evaluations, curve.median - offset * filled, curve.plus_minus)


def published_at(task: str, algorithm: str, evaluations: float) -> tuple[float, dict[str, float]]:
    """Return the published medians at the greatest published number of evaluations up to a given one.

    Args:
        task: Name of the task.
        algorithm: Value of the setting `algorithm`.
        evaluations: Number of evaluations.

    Returns:
        That number, and the medians by metric; 0 and an empty dict if nothing was published that early.
    """
    curves = {metric: paper_curve(task, algorithm, metric) for metric in QUANTITIES}
    points = [
        at for c in curves.values() if c for at in c.evaluations.tolist() if at <= evaluations
    ]
    if not points:
        return 0.0, {}
    at = max(points)
    return at, {
        metric: float(c.median[c.evaluations == at][0])
        for metric, c in curves.items()
        if c is not None and (c.evaluations == at).any()
    }


def published_beside(runs: Sequence[StoredRun]) -> Iterator[tuple[str, str, float]]:
    """Yield task, algorithm and evaluations of all published medians that the table and the curves of runs may have."""
    for task in dict.fromkeys(run.spec.name for run in runs):
        reached: dict[str, list[int]] = defaultdict(list)
        for run in runs:
            if run.spec.name == task:
                reached[run.settings.algorithm].append(run.metrics[-1].evaluations)
        for algorithm, counts in reached.items():
            yield task, algorithm, min(counts)
        whole = [run for run in runs if run.spec.name == task and not run.is_thinned]
        for algorithm in curves_beside(run.settings.algorithm for run in whole) if whole else ():
            yield task, algorithm, max(run.metrics[-1].evaluations for run in whole)


def require_published(wanted: Iterable[tuple[str, str, float]]) -> None:
    """Print a note on tasks without published medians that could be added.

    Args:
        wanted: Task, algorithm and number of evaluations of what published medians could be added to.

    Raises:
        RequestError: There are none for any of the tasks.
    """
    wanted = list(wanted)
    known = {place[0] for place in wanted if published_at(*place)[1]}
    words = [
        f"{task} by {algorithm} within {evaluations:,.0f} evaluations" if task in TASKS else task
        for task, algorithm, evaluations in wanted
        if task not in known
    ]
    if not words:
        return
    what = f"the authors published nothing on {', '.join(dict.fromkeys(words))}"
    if not known:
        raise RequestError(
            f"--paper: {what}; leave it out. They did on {', '.join(TASKS)}, by {', '.join(SYSTEMS)}."
        )
    print(f"note: {what}", file=sys.stderr)


@cache
def _curves() -> dict[tuple[str | None, str | None, str | None], PaperCurve]:
    """Return all published curves by task, system and quantity, under the authors' names."""
    points: dict[tuple[str | None, str | None, str | None], list[tuple[float, float, float]]] = {}
    with FILE.open() as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            if row["median"]:  # empty where the curve was hidden behind others
                point = tuple(float(row[n]) for n in ("evaluations", "median", "plus_minus"))
                key = row["task"], row["system"], row["quantity"]
                points.setdefault(key, []).append(point)  # type: ignore[arg-type]
    return {key: PaperCurve(*np.array(sorted(rows)).T) for key, rows in points.items()}
