"""``ros2 run pga_me_ros experiment FILE``: runs systems on tasks with several seeds, and resumes where it stopped."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.core.storage.database import explained
from pga_me_ros.core.storage.file_lock import FileLock
from pga_me_ros.core.storage.files import make_folder, replace_file
from pga_me_ros.errors import RequestError
from pga_me_ros.experiment.experiment_file import read_experiment
from pga_me_ros.experiment.matrix import Matrix
from pga_me_ros.experiment.plan import COPY, Cell
from pga_me_ros.experiment.stored_cell import evaluations_so_far, require_own_run
from pga_me_ros.paths import user_path
from pga_me_ros.process.command_words import positionals_first
from pga_me_ros.process.program import run_program
from pga_me_ros.process.signals import Signals
from pga_me_ros.process.terminal import Terminal
from pga_me_ros.ros.environment import LAST_DOMAIN, domain_of

LOCK = "experiment.lock"

EXIT_FAILURES = 1
"""Some runs failed; all others are finished."""


def main(args: Sequence[str] | None = None) -> int:
    """Carry out an experiment.

    Args:
        args: Command line without the program's name, None for that of this process.

    Returns:
        Exit status: 0 if every run is finished, 1 if some failed, 2 if it cannot start, 128 + the signal's number if
        one stopped it.
    """
    words = sys.argv[1:] if args is None else args
    options = _parser().parse_args(positionals_first(words, "--cell", _may_be_cell))
    code = 0

    def work() -> None:
        nonlocal code
        code = _listed(options) if options.list else _carried_out(options)

    return run_program(work) or code


def _listed(options: argparse.Namespace) -> int:
    """Print the matrix, one line per cell with its progress."""
    for cell in read_experiment(options.file).chosen(options.cell):
        done = evaluations_so_far(cell.folder(_folder(options)))
        settings = cell.settings
        wanted = settings.generations * settings.batch_size
        print(f"{cell.index:4d}  {cell.name}  {done:,} of {wanted:,} evaluations")
    return 0


def _carried_out(options: argparse.Namespace) -> int:
    """Run the chosen cells; return the exit status."""
    experiment, folder = read_experiment(options.file), _folder(options)
    domain = domain_of(os.environ)
    cells = experiment.chosen(options.cell)
    cores = len(os.sched_getaffinity(0))
    jobs = cores if options.jobs is None else options.jobs
    if jobs < 1:
        raise RequestError(f"--jobs is {jobs}; give 1 or more.")
    for cell in cells:
        require_own_run(cell, cell.folder(folder))
    make_folder(folder)
    # Single cells may run in parallel, each with its own lock: array jobs, or several hosts that share a disk.
    lock = None if options.cell else FileLock(folder / LOCK)
    try:
        _keep_copy(options.file, folder)
        return _run(cells, folder, jobs, cores, domain)
    finally:
        if lock:
            lock.release()


def _run(cells: Sequence[Cell], folder: Path, jobs: int, cores: int, domain: int) -> int:
    signals, terminal = Signals(), Terminal()
    matrix = Matrix(cells, folder, jobs=jobs, cores=cores, domain=domain, terminal=terminal)
    domain_of(os.environ, LAST_DOMAIN - matrix.further_domains)
    matrix.run(signals)
    of = f"{matrix.finished} of {len(cells)} runs"
    for failure in matrix.failures:
        terminal.say(f"failed: {failure}")
    if signals.received:
        terminal.say(f"stopped: {of} in {folder} are finished; the same command resumes")
        return 128 + signals.received
    if matrix.failures:
        terminal.say(f"{of} in {folder} are finished; the same command retries the others")
        return EXIT_FAILURES
    terminal.say(f"finished: {of} in {folder}")
    return 0


def _folder(options: argparse.Namespace) -> Path:
    return options.folder or Path("experiments") / options.file.stem


def _keep_copy(file: Path, folder: Path) -> None:
    """Keep the experiment file in its folder.

    Raises:
        StorageError: The copy cannot be written.
    """
    copy, content = folder / COPY, file.read_bytes()
    with explained(copy):
        if not copy.exists() or copy.read_bytes() != content:
            replace_file(copy, content, shared=True)  # cells that start in parallel all do this


def _may_be_cell(word: str) -> bool:
    return not word.endswith((".yaml", ".yml"))


def _parser() -> argparse.ArgumentParser:
    parser = ArgumentParser(
        prog="experiment",
        description="Run the systems, tasks and seeds of a YAML file, as many in parallel as there are cores. "
        "The same command resumes where it stopped; `report FOLDER` compares the results.",
    )
    parser.add_argument("file", type=user_path, metavar="FILE", help="experiment file")
    parser.add_argument(
        "--folder", type=user_path, help="where the runs are kept (experiments/NAME-OF-FILE)"
    )
    parser.add_argument("--jobs", type=int, metavar="N", help="runs in parallel (one per core)")
    parser.add_argument(
        "--cell",
        nargs="+",
        default=[],
        metavar="CELL",
        help="only these: SYSTEM/TASK/SEED, an index, or a pattern such as 'td3/*/*'",
    )
    parser.add_argument("--list", action="store_true", help="print the matrix and do nothing")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
