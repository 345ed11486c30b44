"""``ros2 run pga_me_ros reevaluate RUN --repeats 10``: mean fitness of elites, stored next to the repertoire."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.corrected import corrected_metrics, in_words
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.reevaluating import Reevaluating, fittest_first
from pga_me_ros.core.storage.reevaluations import MOST_REPEATS, Reevaluations, fitness_differences
from pga_me_ros.core.storage.run_info import RunInfo, changed_fields, library_versions
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.paths import user_path
from pga_me_ros.process.program import run_program
from pga_me_ros.process.streams import tell
from pga_me_ros.reevaluate.workers import Job, SimulatedWorld, evaluated
from pga_me_ros.tasks.randomization import canonical
from pga_me_ros.tasks.registry import randomization_option, task_spec

MOST_PROCESSES = 1000

PIECE = 10
"""Repeats of one elite in a job."""

LINE_PERIOD = 5.0
"""Seconds between two lines of progress if standard error is not a terminal."""

SAVE_PERIOD = 10.0
"""Seconds between two writes of the outcomes so far."""


def main(args: Sequence[str] | None = None) -> int:
    """Re-evaluate elites, store the outcomes, print a summary.

    Args:
        args: Command line without the program's name, None for the process's own.

    Returns:
        Exit status, as `run_program`. Ctrl-C keeps the outcomes so far.
    """
    options = _parser().parse_args(args)

    def work() -> None:
        print(
            reevaluate(
                options.run,
                options.repeats,
                options.best,
                options.processes,
                options.bests,
                options.randomization,
            )
        )

    return run_program(work, stopped="stopped; the same command continues from here")


def reevaluate(
    run: Path,
    repeats: int,
    best: int | None = None,
    processes: int = 0,
    bests: bool = False,
    randomization: str | None = None,
) -> str:
    """Re-evaluate elites until each has the given number of repeats; stored repeats count.

    Args:
        run: Folder of the run, or its repertoire file. The repertoire is only read, and may be growing.
        repeats: Wanted number of repeats of each elite.
        best: Number of fittest elites to re-evaluate, None for all.
        processes: Number of processes, 0 for one per core.
        bests: Whether to re-evaluate the best controller of every generation instead of the current elites.
        randomization: What varies from episode to episode; None for the run's setting, empty for nothing. If it differs
            from the run's, the outcomes go to a separate file and do not affect what is served.

    Returns:
        A summary of the statistics.

    Raises:
        StorageError: The run cannot be read, holds no behavior yet, or the outcomes cannot be stored.
        RequestError: A number is out of range, or the best controllers are unknown.
        TaskError: The run's task does not start.
    """
    if best is not None and best < 1:
        raise RequestError(f"--best is {best}; give 1 or more.")
    for name, value, least, most in (
        ("repeats", repeats, 1, MOST_REPEATS),
        ("processes", processes, 0, MOST_PROCESSES),
    ):
        if not least <= value <= most:
            raise RequestError(f"--{name} is {value}; give {least} to {most:,}.")
    stored = StoredRun.load(run)
    file, info, archive = stored.file, stored.info, stored.archive
    on_the_way = stored.bests() if bests else []
    if archive.note:
        print(f"note: {archive.note}", file=sys.stderr)
    _require_same_task(info)
    if bests and not on_the_way:
        raise RequestError(
            f"'{file}' does not say which controllers were the best ones (an older version stored it); omit --bests."
        )
    own = stored.settings.randomization
    world = SimulatedWorld(
        stored.settings.task, canonical(own if randomization is None else randomization)
    )
    randomization_option(world.task, world.randomization)  # refuses what the task cannot have
    elsewhere = _elsewhere(stored, world.randomization)
    if bests and elsewhere is not None:
        raise RequestError("--bests is about the run's own world; leave out --randomization.")
    chosen = (
        {elite.evaluation: elite.parameters for elite in on_the_way}
        if bests
        else fittest_first(archive, best)
    )
    work = Reevaluating(stored, chosen, repeats, elsewhere)
    try:
        _carry_out(work, info, world, chosen, processes)
        work.finish()
    finally:
        work.close()
    if bests:
        return luck(stored.metrics, work.rows, repeats)
    text = summary(archive, work.rows.statistics(archive))
    if elsewhere is None:
        return text
    return f"randomized: {elsewhere or 'nothing'} (the run: {own or 'nothing'})\n{text}"


def _elsewhere(stored: StoredRun, randomization: str) -> str | None:
    """Return the text under which a world's outcomes are stored, None for the run's own world.

    Args:
        stored: The run.
        randomization: The world, as `canonical` returns it. Earlier versions stored it as it was given; what they have
            stored is continued.
    """
    if randomization == canonical(stored.settings.randomization):
        return None
    texts = [rows.elsewhere or "" for rows in stored.elsewhere]
    same = [text for text in texts if canonical(text) == randomization]
    return randomization if randomization in same or not same else same[0]


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
    """Return a summary of the statistics of an archive's elites, at least one of which was re-evaluated."""
    measured = corrected_metrics(archive, known)
    assert measured is not None
    best = known.as_elites(archive).best()
    spread = f"{known.fitness_spread[best.cell]:.1f}" if known.repeats[best.cell] > 1 else "unknown"
    return "\n".join(
        [
            f"{measured.elites} of {archive.coverage} elites were re-evaluated, {measured.repeats} times or more",
            *in_words(measured, archive),
            f"best on average: cell {best.cell} with {best.fitness:.1f} "
            f"(spread {spread}, found with {archive.fitness[best.cell]:.1f})",
        ]
    )


def _require_same_task(info: RunInfo) -> None:
    """Check that the task is the one that the elites were found in."""
    own, now = info.task, task_spec(info.settings["task"]).to_json()
    changed = changed_fields(own, now)
    if changed:
        raise StorageError(
            f"The task '{info.settings['task']}' is not what it was when the run was made: its spec differs in "
            f"{', '.join(changed)}. Use the version of the task that the run was made with."
        )
    for difference in info.version_differences(library_versions()):
        print(f"note: library version differs from the run's: {difference}", file=sys.stderr)


def _carry_out(
    work: Reevaluating,
    info: RunInfo,
    world: SimulatedWorld,
    chosen: dict[int, Float32Array],
    processes: int,
) -> None:
    """Do the missing repeats, and store the outcomes from time to time."""
    total, done, saved = len(work.missing), 0, -math.inf
    if not total:
        return
    results = evaluated(
        _jobs(chosen, work.missing),
        world,
        MlpShape(info.layer_sizes),
        info.settings["seed"],
        processes or os.cpu_count() or 1,
    )
    progress = _Progress(total)
    try:
        for outcomes in results:
            work.take(outcomes)
            done += len(outcomes)
            progress.show(done)
            if time.monotonic() > saved + SAVE_PERIOD:
                work.save()
                saved = time.monotonic()
    finally:
        progress.close()
        results.close()
        work.save()


def _jobs(chosen: dict[int, Float32Array], missing: list[tuple[int, int]]) -> list[Job]:
    """Split the missing repeats into jobs of a few seconds, so that an interruption loses little."""
    wanted: dict[int, list[int]] = {}
    for evaluation, repeat in missing:
        wanted.setdefault(evaluation, []).append(repeat)
    return [
        Job(evaluation, tuple(piece), chosen[evaluation])
        for evaluation, repeats in wanted.items()
        for piece in (repeats[i : i + PIECE] for i in range(0, len(repeats), PIECE))
    ]


class _Progress:
    """Progress on standard error: in place on a terminal, otherwise a line now and then.

    Args:
        total: Number of evaluations to do.
    """

    def __init__(self, total: int) -> None:
        self._total = total
        self._in_place = sys.stderr.isatty()
        self._due = -math.inf
        self.show(0)

    def show(self, done: int) -> None:
        """Show how many evaluations are done."""
        text = f"{done} of {self._total} evaluations"
        if self._in_place:
            tell(f"\r{text}", sys.stderr, end="")
        elif done == self._total or time.monotonic() >= self._due:
            tell(text, sys.stderr)
            self._due = time.monotonic() + LINE_PERIOD

    def close(self) -> None:
        """End the line."""
        if self._in_place:
            tell("", sys.stderr)


def _parser() -> argparse.ArgumentParser:
    parser = ArgumentParser(
        prog="reevaluate",
        description="Re-evaluate the elites of a run from other initial poses, and store the outcomes next to its "
        "repertoire. Behaviors then have a mean, a spread and a share of falls, and the corrected archive is known. "
        "More repeats can be added at any time.",
    )
    parser.add_argument(
        "run", type=user_path, metavar="RUN", help="folder of a run, or repertoire file"
    )
    parser.add_argument("--repeats", type=int, default=10, metavar="N", help="per elite (10)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--best", type=int, metavar="N", help="only the N fittest elites")
    which.add_argument(
        "--bests",
        action="store_true",
        help="the best controller of every generation instead, for the fitness difference of the paper",
    )
    parser.add_argument(
        "--randomization",
        metavar="TEXT",
        help="what varies from episode to episode instead of the run's setting, such as 'friction 0.4 0.8, mass 0.8 "
        "1.2', or '' for nothing; the outcomes go to a separate file and do not affect what is served",
    )
    parser.add_argument(
        "--processes", type=int, default=0, metavar="N", help="number of processes; 0: one per core"
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
