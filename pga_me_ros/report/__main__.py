"""``ros2 run pga_me_ros report RUN...``: archive, lineage and learning curves of stored runs, and a table."""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path

import numpy as np

from pga_me_ros.core.program import run_program
from pga_me_ros.report.stored_run import StoredRun


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
            lines.append(_line(task, str(run.seed), rows[-1]))
        if len(rows) > 1:
            lines.append(_line(task, "median", tuple(np.median(rows, axis=0))))
    return "\n".join(lines)


def _line(task: str, seed: str, row: tuple[float, ...]) -> str:
    return f"| {task} | {seed} | " + " | ".join(f"{value:,.0f}" for value in row) + " |"


def main() -> int:
    """Draw the pictures, print the table."""
    parser = argparse.ArgumentParser(prog="report", description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path, help="folders of runs, or repertoire files")
    parser.add_argument(
        "--out", type=Path, default=Path("report"), help="folder for the pictures (report)"
    )
    arguments = parser.parse_args()

    def work() -> None:
        runs = [StoredRun.load(path) for path in arguments.runs]
        arguments.out.mkdir(parents=True, exist_ok=True)
        print(table(runs))
        for file in draw(runs, arguments.out):
            print(file)

    return run_program(work)


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
