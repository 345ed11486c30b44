"""``ros2 run pga_me_ros experiment FILE``: runs systems on tasks with several seeds, and goes on where it stopped."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

from pga_me_ros.core.errors import RequestError
from pga_me_ros.core.file_lock import FileLock, LockedError
from pga_me_ros.core.folders import make_folder
from pga_me_ros.core.program import run_program
from pga_me_ros.core.storage_file import explained
from pga_me_ros.core.terminal import Terminal
from pga_me_ros.experiment.experiment_file import read_experiment
from pga_me_ros.experiment.matrix import Matrix, Signals
from pga_me_ros.experiment.plan import COPY, Cell
from pga_me_ros.experiment.stored_cell import evaluations_so_far, require_own_run

LOCK = "experiment.lock"

EXIT_FAILURES = 1
"""Some runs failed; all others are finished."""


def main(args: Sequence[str] | None = None) -> int:
    """Carry out an experiment.

    Args:
        args: Command line without the program's name, None for the process's own.

    Returns:
        Exit status: 0 when every run is finished, 1 when some failed, 2 for what cannot be started, 128 + the signal's
        number when one ended it.
    """
    asked = _parser().parse_args(args)
    code = 0

    def work() -> None:
        nonlocal code
        code = _listed(asked) if asked.list else _carried_out(asked)

    return run_program(work) or code


def _listed(asked: argparse.Namespace) -> int:
    """Print the matrix, one cell a line, and how far each of them is."""
    for cell in read_experiment(asked.file).chosen(asked.cell):
        done = evaluations_so_far(cell.folder(_folder(asked)))
        settings = cell.settings
        wanted = settings.generations * settings.batch_size
        print(f"{cell.index:4d}  {cell.name}  {done:,} of {wanted:,} evaluations")
    return 0


def _carried_out(asked: argparse.Namespace) -> int:
    """Run the cells that are asked for; returns the exit status."""
    experiment, folder = read_experiment(asked.file), _folder(asked)
    cells = experiment.chosen(asked.cell)
    cores = len(os.sched_getaffinity(0))
    jobs = cores if asked.jobs is None else asked.jobs
    if jobs < 1:
        raise RequestError(f"--jobs is {jobs}; give 1 or more.")
    for cell in cells:
        require_own_run(cell, cell.folder(folder))
    make_folder(folder)
    # Single cells may go on side by side, each with a lock of its own: array jobs, or several hosts with one disk.
    lock = None if asked.cell else _locked(folder)
    try:
        _keep_copy(asked.file, folder)
        return _run(cells, folder, jobs, cores)
    finally:
        if lock:
            lock.release()


def _run(cells: Sequence[Cell], folder: Path, jobs: int, cores: int) -> int:
    signals, terminal = Signals(), Terminal()
    domain = int(os.environ.get("ROS_DOMAIN_ID") or 0)
    matrix = Matrix(cells, folder, jobs=jobs, cores=cores, domain=domain, terminal=terminal)
    matrix.run(signals)
    of = f"{matrix.finished} of {len(cells)} runs"
    for failure in matrix.failures:
        print(f"failed: {failure}")
    if signals.received:
        print(f"stopped: {of} in {folder} are finished; the same command goes on from here")
        return 128 + signals.received
    if matrix.failures:
        print(f"{of} in {folder} are finished; the same command tries the others again")
        return EXIT_FAILURES
    print(f"finished: {of} in {folder}")
    return 0


def _folder(asked: argparse.Namespace) -> Path:
    return asked.folder or Path("experiments") / asked.file.stem


def _locked(folder: Path) -> FileLock:
    """Take the folder for this experiment alone.

    Raises:
        LockedError: Another one has it.
    """
    try:
        return FileLock(folder / LOCK)
    except LockedError as error:
        raise LockedError(f"{error}".replace("run_dir", "--folder")) from None


def _keep_copy(file: Path, folder: Path) -> None:
    """Keep the experiment file in its folder.

    Raises:
        StorageError: It cannot be written.
    """
    copy, content = folder / COPY, file.read_bytes()
    with explained(copy):
        if not copy.exists() or copy.read_bytes() != content:
            new = copy.with_name(
                f"{COPY}.{os.getpid()}"
            )  # cells that start side by side all do this
            new.write_bytes(content)
            os.replace(new, copy)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="experiment",
        description="Run the systems, tasks and seeds that a YAML file names, as many side by side as there are cores. "
        "The same command goes on where it stopped; `report FOLDER` compares what came out.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="experiment file")
    parser.add_argument(
        "--folder", type=Path, help="where the runs are kept (experiments/NAME-OF-FILE)"
    )
    parser.add_argument("--jobs", type=int, metavar="N", help="runs side by side (one per core)")
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
