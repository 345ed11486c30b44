"""``ros2 run pga_me_ros reevaluate RUN --repeats 10``: mean fitness of elites, stored next to the repertoire."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.file_lock import FileLock
from pga_me_ros.core.storage.reevaluations import (
    FILE,
    Reevaluations,
    Statistics,
    fitness_differences,
)
from pga_me_ros.core.storage.run_info import RunInfo, changed_fields, library_versions
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.process.program import run_program
from pga_me_ros.process.streams import tell
from pga_me_ros.reevaluate.workers import Job, Outcome, evaluated
from pga_me_ros.tasks.registry import task_spec

PIECE = 10
"""Repeats of one elite that a process does at a time."""

SAVE_PERIOD = 10.0
"""Seconds between two writes of what was found so far."""


def main(args: Sequence[str] | None = None) -> int:
    """Evaluate elites again, store the outcomes, print what they say.

    Args:
        args: Command line without the program's name, None for the process's own.

    Returns:
        Exit status, as `run_program`; after Ctrl-C, what was found until then is stored.
    """
    options = _parser().parse_args(args)

    def work() -> None:
        print(
            reevaluate(options.run, options.repeats, options.best, options.processes, options.bests)
        )

    return run_program(work, stopped="stopped; the same command continues from here")


def reevaluate(
    run: Path,
    repeats: int,
    best: int | None = None,
    processes: int = 0,
    bests: bool = False,
) -> str:
    """Evaluate elites until each has so many repeats; those that are there already are not done again.

    Args:
        run: Folder of the run, or its repertoire file. The repertoire is only read, and may be growing.
        repeats: Wanted repeats of each elite.
        best: Only so many of the fittest elites, None for all.
        processes: Processes to use, 0 for one per core.
        bests: Whether to evaluate the best controller of every generation in place of the elites there are now.

    Returns:
        What the statistics say, in words.

    Raises:
        StorageError: The run cannot be read, holds no behavior yet, or the outcomes cannot be stored.
        RequestError: A number makes no sense, or the best controllers are not known.
        TaskError: The run's task does not start.
    """
    numbers = {"repeats": (repeats, 1), "best": (best, 1), "processes": (processes, 0)}
    for name, (value, least) in numbers.items():
        if value is not None and value < least:
            raise RequestError(f"--{name} is {value}; give {least} or more.")
    stored = StoredRun.load(run)
    file, info, archive = stored.file, stored.info, stored.archive
    on_the_way = stored.bests() if bests else []
    if archive.note:
        print(f"note: {archive.note}", file=sys.stderr)
    _require_same_task(info)
    if bests and not on_the_way:
        raise RequestError(
            f"'{file}' does not tell which controllers were the best ones (an older program stored it); omit --bests."
        )
    chosen = (
        {elite.evaluation: elite.parameters for elite in on_the_way}
        if bests
        else _chosen(archive, best)
    )
    lock = FileLock(file.with_name(f"{FILE}.lock"))
    try:
        rows = _grown(file, info, archive.dimensions, repeats, chosen, processes)
    finally:
        lock.release()
    return (
        luck(stored.metrics, rows, repeats) if bests else summary(archive, rows.statistics(archive))
    )


def luck(metrics: Sequence[Metrics], rows: Reevaluations, repeats: int) -> str:
    """Return the fitness difference of the best controllers, in words."""
    differences = fitness_differences(metrics, rows, repeats)
    last, count = metrics[-1], len({m.best_evaluation for m in metrics})
    return (
        f"{count} controllers were the best one on the way; the last has the fitness {last.max_fitness:.1f} in one "
        f"evaluation, {last.max_fitness - differences[-1]:.1f} on average of {repeats} "
        f"(difference {differences[-1]:.1f})"
    )


def summary(archive: Archive, known: Statistics) -> str:
    """Return what statistics say about an archive's elites, in words."""
    cells = np.flatnonzero(archive.filled & (known.repeats > 0))
    once, mean = archive.fitness[cells], known.mean_fitness[cells]
    moved = np.linalg.norm(archive.descriptors[cells] - known.mean_descriptor[cells], axis=1)
    seen = known.as_elites(archive)
    best = seen.best()
    return "\n".join(
        [
            f"{len(cells)} of {archive.coverage} elites were re-evaluated, {known.repeats[cells].min()} times or more",
            f"fitness: {once.mean():.1f} when they were found, {mean.mean():.1f} on average since "
            f"(difference {(once - mean).mean():.1f})",
            f"descriptor: the mean lies {moved.mean():.3f} from the one that they were found with",
            f"best on average: cell {best.cell} with {best.fitness:.1f} "
            f"(spread {known.fitness_spread[best.cell]:.1f}, found with {archive.fitness[best.cell]:.1f})",
        ]
    )


def _require_same_task(info: RunInfo) -> None:
    """Make sure that what is simulated is what the elites were found in."""
    own, now = info.task, task_spec(info.settings["task"]).to_json()
    changed = changed_fields(own, now)
    if changed:
        raise StorageError(
            f"The task '{info.settings['task']}' is not what it was when the run was made: its spec differs in "
            f"{', '.join(changed)}. Use the version of the task that the run was made with."
        )
    for difference in info.version_differences(library_versions()):
        print(f"note: not the library that the run was made with: {difference}", file=sys.stderr)


def _chosen(archive: Archive, best: int | None) -> dict[int, np.ndarray]:
    """Return the parameters of the elites to evaluate by their evaluation ids, the fittest first."""
    cells = archive.filled_cells()
    fittest_first = cells[np.argsort(-archive.fitness[cells], kind="stable")]
    return {int(archive.evaluations[c]): archive.parameters[c] for c in fittest_first[:best]}


def _grown(
    file: Path,
    info: RunInfo,
    dimensions: int,
    repeats: int,
    chosen: dict[int, np.ndarray],
    processes: int,
) -> Reevaluations:
    """Return all re-evaluations of a run after those that were missing were done, and stored on the way."""
    rows = Reevaluations.load(file, info.run_id, dimensions)
    jobs = _jobs(chosen, rows.missing(np.array(list(chosen), np.int64), repeats))
    total = sum(len(job.repeats) for job in jobs)
    new: list[Outcome] = []
    saved = -math.inf
    results = evaluated(
        jobs,
        info.settings["task"],
        MlpShape(info.layer_sizes),
        info.settings["seed"],
        processes or os.cpu_count() or 1,
    )
    try:
        for outcomes in results if jobs else ():
            new += outcomes
            _show(f"\r{len(new)} of {total} evaluations")
            if time.monotonic() > saved + SAVE_PERIOD:
                rows.with_more(_rows(new, rows)).save(file)
                saved = time.monotonic()
    finally:
        _show("\n" if new else "")
        results.close()
        if new:
            rows = rows.with_more(_rows(new, rows))
            rows.save(file)
    return rows


def _jobs(chosen: dict[int, np.ndarray], missing: list[tuple[int, int]]) -> list[Job]:
    """Return what is missing in pieces that are done in seconds, so that little is lost when it is cut off."""
    wanted: dict[int, list[int]] = {}
    for evaluation, repeat in missing:
        wanted.setdefault(evaluation, []).append(repeat)
    return [
        Job(evaluation, tuple(piece), chosen[evaluation])
        for evaluation, repeats in wanted.items()
        for piece in (repeats[i : i + PIECE] for i in range(0, len(repeats), PIECE))
    ]


def _rows(outcomes: list[Outcome], of: Reevaluations) -> Reevaluations:
    """Return outcomes as rows, in an order that does not depend on who was faster."""
    done = sorted(outcomes, key=lambda o: (o.evaluation, o.repeat))
    return Reevaluations(
        run_id=of.run_id,
        evaluation=np.array([o.evaluation for o in done], np.int64),
        repeat=np.array([o.repeat for o in done], np.int64),
        fitness=np.array([o.fitness for o in done], np.float64),
        descriptor=np.stack([o.descriptor for o in done]),
        steps=np.array([o.steps for o in done], np.int64),
        terminated=np.array([o.terminated for o in done], np.bool_),
    )


def _show(text: str) -> None:
    """Show progress on a terminal."""
    if sys.stderr.isatty():
        tell(text, sys.stderr, end="")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="reevaluate",
        description="Evaluate the elites of a run again from other initial poses, and store mean and spread of fitness "
        "and descriptor next to its repertoire. More repeats may be added at any time.",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="folder of a run, or repertoire file")
    parser.add_argument("--repeats", type=int, default=10, metavar="N", help="per elite (10)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--best", type=int, metavar="N", help="only the N fittest elites")
    which.add_argument(
        "--bests",
        action="store_true",
        help="the best controller of every generation instead, for the fitness difference of the paper",
    )
    parser.add_argument(
        "--processes", type=int, default=0, metavar="N", help="to use; 0, the default: one per core"
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
