"""``ros2 run pga_me_ros report RUN...``: archive, lineage and learning curves of stored runs, and a table.

Of an experiment's folder, or with --compare: systems side by side, with medians and p-values.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np

from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError
from pga_me_ros.process.program import run_program
from pga_me_ros.report.compared_run import ComparedRun
from pga_me_ros.report.comparison import Comparison, compare, compare_experiment, is_experiment
from pga_me_ros.report.comparison_table import comparison_table


def table(runs: list[StoredRun]) -> str:
    """Return the final metrics of runs as a Markdown table, medians last where a task has several."""
    lines = [
        "| task | seed | evaluations | coverage | QD-score | best fitness |",
        "|---|---|---|---|---|---|",
    ]
    by_task: dict[str, list[StoredRun]] = defaultdict(list)
    for run in runs:
        by_task[run.spec.name].append(run)
    for task, group in by_task.items():
        rows = []
        for run in group:
            last = run.metrics[-1]
            rows.append((last.evaluations, last.coverage, last.qd_score, last.max_fitness))
            lines.append(_line(task, str(run.settings.seed), rows[-1]))
        if len(rows) > 1:
            lines.append(_line(task, "median", tuple(np.median(rows, axis=0))))
    return "\n".join(lines)


def _line(task: str, seed: str, row: tuple[float, ...]) -> str:
    return f"| {task} | {seed} | " + " | ".join(f"{value:,.0f}" for value in row) + " |"


def main() -> int:
    """Draw the pictures, print the table."""
    parser = argparse.ArgumentParser(prog="report", description=__doc__)
    parser.add_argument(
        "runs",
        nargs="+",
        type=Path,
        help="folders of runs, repertoire files, or an experiment's folder",
    )
    parser.add_argument(
        "--compare",
        action="store_true",
        help="compare the systems of the runs; the folder of an experiment always is compared",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("report"), help="folder for the pictures (report)"
    )
    arguments = parser.parse_args()

    def work() -> None:
        comparison = compared(arguments.runs, asked=arguments.compare)
        if comparison:
            arguments.out.mkdir(parents=True, exist_ok=True)
            table_file = arguments.out / "comparison.md"
            print(comparison_table(comparison))
            table_file.write_text(comparison_table(comparison) + "\n")
            for file in [table_file, *draw_comparison(comparison, arguments.out)]:
                print(file)
            return
        runs = [StoredRun.load(path) for path in arguments.runs]
        for run in runs:
            if run.archive.note:
                print(f"note: '{run.name}': {run.archive.note}", file=sys.stderr)
        arguments.out.mkdir(parents=True, exist_ok=True)
        print(table(runs))
        for file in draw(runs, arguments.out):
            print(file)

    return run_program(work)


def compared(paths: list[Path], *, asked: bool) -> Comparison | None:
    """Return the comparison of an experiment or of runs, None where there is nothing to compare.

    Raises:
        RequestError: Paths are mixed, or the runs cannot be compared.
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


def draw_comparison(comparison: Comparison, folder: Path) -> list[Path]:
    """Draw Figure 3 and Figure 4 of the paper; returns the files."""
    from pga_me_ros.report.comparison_pictures import draw_archives_compared, draw_curves_compared

    return draw_curves_compared(comparison, folder) + draw_archives_compared(comparison, folder)


def draw(runs: list[StoredRun], folder: Path) -> list[Path]:
    """Draw an archive and a lineage per run, and learning curves per task; returns the files."""
    # matplotlib takes a second to import: errors in what was asked for come first.
    from pga_me_ros.report.lineage import draw_lineage
    from pga_me_ros.report.pictures import draw_archive, draw_curves

    files = []
    for run in runs:
        files += draw_archive(run, folder) + draw_lineage(run, folder)
    for task in dict.fromkeys(run.spec.name for run in runs):
        files += draw_curves([run for run in runs if run.spec.name == task], folder)
    return files


if __name__ == "__main__":
    raise SystemExit(main())
