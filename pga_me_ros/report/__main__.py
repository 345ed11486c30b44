"""``ros2 run pga_me_ros report RUN...``: archive, lineage and learning curves of stored runs, and a table.

For an experiment's folder, or with --compare: systems side by side, with medians and p-values.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.core.archive.corrected import complete_metrics
from pga_me_ros.core.storage.distinct import require_distinct
from pga_me_ros.core.storage.files import make_folder, save_bytes
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError
from pga_me_ros.paths import user_path
from pga_me_ros.process.program import run_program
from pga_me_ros.report.compared_run import ComparedRun
from pga_me_ros.report.comparison import Comparison, compare, compare_experiment, is_experiment
from pga_me_ros.report.comparison_table import comparison_table
from pga_me_ros.report.paper import TASKS, published_at, published_beside, require_published

COLUMNS = {
    "evaluations": "{:,.0f}",
    "coverage": "{:,.0f}",
    "QD-score": "{:,.0f}",
    "best fitness": "{:,.0f}",
}
"""Number columns of the table, and their formats."""

CORRECTED = {
    "re-evaluations": "{:,.0f}",
    "corrected coverage": "{:,.0f}",
    "corrected QD-score": "{:,.0f}",
    "best mean fitness": "{:,.0f}",
    "fitness difference": "{:,.0f}",
    "descriptor error": "{:.3f}",
    "falls": "{:.1%}",
}
"""Further columns for runs whose elites were re-evaluated."""

CORRECTED_NOTE = (
    "Corrected: all elites re-evaluated from other initial poses, each at least the given number of times, and added "
    "to an empty archive by their means (Flageat & Cully 2023). Fitness difference and descriptor error: between the "
    "original evaluation and these means, averaged over the elites. Falls: share of re-evaluations that ended in one."
)


def table(runs: list[StoredRun], *, paper: bool = False) -> str:
    """Return the final metrics of runs as a Markdown table, with medians if an algorithm has several runs on a task.

    With `paper`, the authors' medians follow, at the last published number of evaluations that all these runs have
    reached.

    Runs whose elites were all re-evaluated also get corrected metrics, which use the mean of an elite's re-evaluations
    instead of its original, single evaluation.
    """
    again = any(run.corrected for run in runs)
    formats = COLUMNS | CORRECTED if again else COLUMNS
    heads = ["task", "algorithm", "seed", *formats]
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    groups: dict[tuple[str, str], list[StoredRun]] = defaultdict(list)
    for run in runs:
        groups[run.spec.name, run.settings.algorithm].append(run)
    for names, group in groups.items():
        lines += _rows(names, group, formats)
        if paper:
            lines += _published(names, group, formats)
    return "\n".join([*lines, "", CORRECTED_NOTE] if again else lines)


def _rows(
    names: tuple[str, str], group: Sequence[StoredRun], formats: Mapping[str, str]
) -> Iterator[str]:
    """Yield a line for each run of an algorithm on a task, and one for the medians of the runs that are not thinned."""
    rows = np.array([_numbers(run)[: len(formats)] for run in group])
    for run, row in zip(group, rows, strict=True):
        part = " (thinned)" if run.is_thinned else ""
        yield _line(names, f"{run.settings.seed}{part}", row, formats)
    whole = rows[[not run.is_thinned for run in group]]
    if len(whole) > 1:
        known = [column[~np.isnan(column)] for column in whole.T]
        medians = [np.median(column) if len(column) else np.nan for column in known]
        yield _line(names, "median", medians, formats)


def elsewhere(runs: Sequence[StoredRun]) -> Iterator[str]:
    """Yield a Markdown table of corrected metrics under other randomizations than the run's own."""
    heads = [
        "task",
        "seed",
        "randomized",
        "re-evaluations",
        "corrected coverage",
        "corrected QD-score",
    ]
    heads += ["best mean fitness", "falls"]
    begun = False
    for run in runs:
        for rows in run.elsewhere:
            m = complete_metrics(run.archive, rows.statistics(run.archive))
            if m is None:
                continue
            if not begun:
                yield from ("", f"| {' | '.join(heads)} |", "|" + "---|" * len(heads))
            begun = True
            numbers = f"{m.repeats} | {m.coverage:,} | {m.qd_score:,.0f} | {m.max_fitness:,.0f} | {m.fall_share:.1%}"
            what = rows.elsewhere or "nothing"
            yield f"| {run.spec.name} | {run.settings.seed} | {what} | {numbers} |"


def _published(
    names: tuple[str, str], group: Sequence[StoredRun], formats: Mapping[str, str]
) -> Iterator[str]:
    """Yield a line for the authors' medians of an algorithm on a task, if they published any."""
    reached = min(run.metrics[-1].evaluations for run in group)
    at, medians = published_at(*names, reached)
    if medians:
        row = [
            at,
            *(medians.get(name, np.nan) for name in ("coverage", "qd_score", "max_fitness")),
        ]
        unknown = [np.nan] * (len(formats) - len(row))
        yield _line(names, "authors' median", [*row, *unknown], formats)


def _numbers(run: StoredRun) -> list[float]:
    """Return a run's numbers in the order of the columns, NaN for unknown ones."""
    last, m = run.metrics[-1], run.corrected
    numbers = [last.evaluations, last.coverage, last.qd_score, last.max_fitness]
    if m is None:
        return [*numbers, *[np.nan] * len(CORRECTED)]
    numbers += [m.repeats, m.coverage, m.qd_score, m.max_fitness]
    return [*numbers, m.fitness_difference, m.descriptor_error, m.fall_share]


def _line(
    names: tuple[str, str], seed: str, row: Iterable[float], formats: Mapping[str, str]
) -> str:
    values = [
        "-" if np.isnan(value) else how.format(value)
        for value, how in zip(row, formats.values(), strict=True)
    ]
    return f"| {' | '.join([*names, seed, *values])} |"


def main(args: Sequence[str] | None = None) -> int:
    """Draw the pictures, print the table.

    Args:
        args: Command line without the program's name, None for that of this process.

    Returns:
        Exit status, as for `run_program`.
    """
    parser = ArgumentParser(prog="report", description=__doc__)
    parser.add_argument(
        "runs",
        nargs="+",
        type=user_path,
        help="folders of runs, repertoire files, or an experiment's folder",
    )
    parser.add_argument(
        "--compare",
        action="store_true",
        help="compare the systems of the runs; an experiment's folder is always compared",
    )
    parser.add_argument(
        "--out", type=user_path, default=Path("report"), help="folder for the pictures (report)"
    )
    parser.add_argument(
        "--paper",
        action="store_true",
        help="add the medians published by the authors of PGA-MAP-Elites to the curves and the table",
    )
    parser.add_argument(
        "--single",
        action="store_true",
        help="draw archives by the elites' original, single evaluations, even if they were re-evaluated",
    )
    options = parser.parse_args(args)

    def work() -> None:
        comparison = compared(options.runs, asked=options.compare)
        for file in _reported(options) if comparison is None else _compared(comparison, options):
            print(file)

    return run_program(work)


def _reported(options: argparse.Namespace) -> list[Path]:
    """Report on runs one by one; returns the files."""
    runs = [StoredRun.load(path) for path in options.runs]
    require_distinct(runs)
    _require_own_names(runs)
    for run in runs:
        if run.archive.note:
            print(f"note: '{run.name}': {run.archive.note}", file=sys.stderr)
    if options.paper:
        require_published(published_beside(runs))
    make_folder(options.out)
    print(table(runs, paper=options.paper))
    for line in elsewhere(runs):
        print(line)
    return draw(runs, options.out, single=options.single, paper=options.paper)


def _compared(comparison: Comparison, options: argparse.Namespace) -> list[Path]:
    """Report on a comparison; returns the files."""
    if options.paper:
        require_published(
            (task.task, runs[0].algorithm, task.evaluations)
            for task in comparison.tasks
            for runs in task.systems.values()
        )
    make_folder(options.out)
    text, file = comparison_table(comparison), options.out / "comparison.md"
    print(text)
    save_bytes(file, f"{text}\n".encode())
    drawn = draw_comparison(comparison, options.out, paper=options.paper, single=options.single)
    return [file, *drawn]


def _require_own_names(runs: Sequence[StoredRun]) -> None:
    """Make sure that each run has a name of its own, which its pictures are named after.

    Raises:
        RequestError: Two have the same.
    """
    seen: dict[str, StoredRun] = {}
    for run in runs:
        other = seen.setdefault(run.name, run)
        if other is not run:
            raise RequestError(
                f"'{run.file}' and '{other.file}' are both in a folder named '{run.name}', so the pictures of one "
                "would replace those of the other; rename one, or report on each with an --out of its own."
            )


def compared(paths: list[Path], *, asked: bool) -> Comparison | None:
    """Return the comparison of an experiment or of runs, None if none is requested.

    Raises:
        RequestError: An experiment is given together with other paths, or the runs cannot be compared.
        StorageError: A run cannot be read.
    """
    experiments = [path for path in paths if is_experiment(path)]
    if experiments and len(paths) > 1:
        raise RequestError(
            f"'{experiments[0]}' is an experiment, which is compared by itself; give it alone, or runs with --compare."
        )
    if experiments:
        return compare_experiment(paths[0])
    return compare([ComparedRun.load(path) for path in paths]) if asked else None


def draw_comparison(
    comparison: Comparison, folder: Path, *, paper: bool = False, single: bool = False
) -> list[Path]:
    """Draw Figures 3 and 4 of the paper, on request with the authors' medians; returns the files."""
    from pga_me_ros.report.comparison_pictures import draw_archives_compared, draw_curves_compared

    curves = draw_curves_compared(comparison, folder, paper=paper)
    return curves + draw_archives_compared(comparison, folder, single=single)


def draw(
    runs: list[StoredRun], folder: Path, *, single: bool = False, paper: bool = False
) -> list[Path]:
    """Draw an archive and a lineage per run, and learning curves per task of runs not thinned; returns the files.

    Args:
        runs: The runs.
        folder: Folder of the files.
        single: Whether archives are drawn by single evaluations even if means are known.
        paper: Whether the authors' medians are drawn under the curves.
    """
    # matplotlib takes a second to import: errors in the arguments come first.
    from pga_me_ros.report.lineage import draw_lineage
    from pga_me_ros.report.pictures import draw_archive, draw_curves

    files = []
    for run in runs:
        files += draw_archive(run, folder, single=single) + draw_lineage(run, folder)
    for task in dict.fromkeys(run.spec.name for run in runs):
        group = [run for run in runs if run.spec.name == task and not run.is_thinned]
        if group:
            files += draw_curves(group, folder, paper=paper and task in TASKS)
    return files


if __name__ == "__main__":
    raise SystemExit(main())
