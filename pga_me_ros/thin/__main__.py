"""``ros2 run pga_me_ros thin RUN --out FOLDER``: a repertoire of a few dozen behaviors that a robot can take along."""

from __future__ import annotations

import argparse
import dataclasses
import math
import shlex
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from pga_me_ros.arguments import ArgumentParser, number, share
from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.corrected import CorrectedMetrics, complete_metrics
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.runs.stored_actor import StoredActor
from pga_me_ros.core.storage.actor_file import save_actor
from pga_me_ros.core.storage.files import make_folder, rename_file, save_bytes
from pga_me_ros.core.storage.reevaluations import Reevaluations
from pga_me_ros.core.storage.run_info import SCHEMA_VERSION
from pga_me_ros.core.storage.stored_run import REPERTOIRE, StoredRun
from pga_me_ros.core.storage.whole_run import store_whole_run
from pga_me_ros.errors import PgaError, RequestError, StorageError
from pga_me_ros.paths import user_path
from pga_me_ros.process.program import run_program
from pga_me_ros.thin.card import card
from pga_me_ros.thin.choosing import Thinning, thinned

CARD = "card.md"

CELLS = 96
"""Behaviors that are kept unless the command line says otherwise."""

FEW_REPEATS = 10
"""Re-evaluations per elite below which means are not worth much."""

LARGE = 10_000_000
"""Bytes above which a repertoire is too large to be shipped."""


def main(args: Sequence[str] | None = None) -> int:
    """Thin a repertoire, and print the folder.

    Args:
        args: Command line without the program's name, None for the process's own.

    Returns:
        Exit status, as `run_program`.
    """
    given = list(sys.argv[1:] if args is None else args)
    options = _parser().parse_args(given)
    # Paths of this machine mean nothing elsewhere.
    words = {str(options.run): "RUN", str(options.out): options.out.name}
    command = shlex.join(["ros2", "run", "pga_me_ros", "thin", *(words.get(w, w) for w in given)])
    return run_program(lambda: print(thin(options, command)))


def thin(options: argparse.Namespace, command: str) -> Path:
    """Carry out a parsed command line.

    Args:
        options: The command line.
        command: The same as it was given, for the card.

    Returns:
        The folder that was written.

    Raises:
        PgaError: The run cannot be read, its elites were not all re-evaluated, none is as steady and fit as wanted, or
            the folder cannot be written or holds a repertoire.
    """
    wanted = _wanted(options)
    run = StoredRun.load(options.run)
    whole = _measured(run)
    actor = _actor(run)
    out: Path = options.out
    if (out / REPERTOIRE).exists():
        raise StorageError(f"'{out}' holds a repertoire; give --out another folder, or remove it.")
    if out.is_dir() and any(out.iterdir()):
        raise StorageError(f"The folder '{out}' is not empty; give --out a new one.")
    kept = thinned(run.archive, run.statistics, wanted)
    elsewhere = [_rows_of(others, kept) for others in run.elsewhere]
    rows = _rows_of(run.reevaluations, kept)
    known = rows.statistics(kept)
    measured = complete_metrics(kept, known)
    assert measured is not None
    info = dataclasses.replace(run.info, schema_version=SCHEMA_VERSION)
    last = _metrics(run.metrics[-1], kept)
    text = card(out.name, run, kept, known, (whole, measured), command, options.remark, actor)
    with _appearing_at_once(out) as folder:
        file, rates = folder / REPERTOIRE, run.generations[-1].rates
        store_whole_run(file, info, kept, [last], rates, closed=True)
        for own in (rows.with_measure(last.generation, measured), *elsewhere):
            own.save(file)
        if actor:
            save_actor(file, info.run_id, run.spec, actor.actor, actor.generation)
        save_bytes(folder / CARD, f"{text}\n".encode())
    size = sum(file.stat().st_size for file in out.iterdir())
    print(f"{len(kept)} behaviors of {run.archive.coverage}, {size / 1e6:.1f} MB", file=sys.stderr)
    if size > LARGE:
        print(f"note: more than {LARGE / 1e6:.0f} MB; lower --cells to ship it", file=sys.stderr)
    return out


@contextmanager
def _appearing_at_once(out: Path) -> Iterator[Path]:
    """Provide a folder whose files come into another one when a block is done, the repertoire last; if it fails, none.

    Raises:
        StorageError: The folder cannot be made, or cannot be written to.
    """
    new = not out.exists()
    make_folder(out)
    try:
        with tempfile.TemporaryDirectory(prefix=".thin-", dir=out) as folder:
            yield Path(folder)
            for file in sorted(Path(folder).iterdir(), key=lambda file: file.name == REPERTOIRE):
                rename_file(file, out / file.name)
    except BaseException:
        if new:
            with suppress(OSError):
                out.rmdir()
        raise


def _wanted(options: argparse.Namespace) -> Thinning:
    """Return what is kept.

    Raises:
        RequestError: A number makes no sense.
    """
    if options.cells < 1:
        raise RequestError(f"--cells is {options.cells}; give 1 or more.")
    limits = {"max-fall-share": options.max_fall_share, "max-spread": options.max_spread}
    fall_share, spread = (
        math.inf if value is None else share(f"--{name}", value) for name, value in limits.items()
    )
    return Thinning(options.cells, fall_share, spread, number("--min-fitness", options.min_fitness))


def _measured(run: StoredRun) -> CorrectedMetrics:
    """Return the measures of a run.

    Raises:
        RequestError: Not all of its elites were re-evaluated, or too seldom for a spread.
    """
    if run.corrected is None or run.corrected.repeats < 2:
        raise RequestError(
            f"Not all elites of '{run.name}' were re-evaluated twice or more, so it is not known what they are worth; "
            f"do so first: ros2 run pga_me_ros reevaluate {run.file.parent} --repeats 20"
        )
    if run.corrected.repeats < FEW_REPEATS:
        print(
            f"note: means of {run.corrected.repeats} re-evaluations only; `reevaluate --repeats 20` tells more",
            file=sys.stderr,
        )
    return run.corrected


def _actor(run: StoredRun) -> StoredActor | None:
    """Return the actor that is taken along, None for none; says so where there should be one."""
    if not algorithm_of(run.settings).conditioned:
        return None
    try:
        actor = StoredActor.of(run)
    except PgaError as error:
        print(f"note: without an actor: {error}", file=sys.stderr)
        return None
    if actor.note:
        print(f"note: {actor.note}", file=sys.stderr)
    return actor


def _rows_of(rows: Reevaluations, kept: Archive) -> Reevaluations:
    """Return the re-evaluations of the elites that are kept."""
    mine = np.isin(rows.evaluation, kept.evaluations[kept.filled_cells()])
    names = ("evaluation", "repeat", "fitness", "descriptor", "steps", "terminated")
    columns = {name: getattr(rows, name)[mine] for name in names}
    return dataclasses.replace(rows, **columns, measured=())


def _metrics(last: Metrics, kept: Archive) -> Metrics:
    """Return metrics of the thinned archive as those of a first generation, which is all that its file has."""
    return dataclasses.replace(
        last,
        generation=0,
        coverage=kept.coverage,
        coverage_share=kept.coverage / kept.cells,
        qd_score=kept.qd_score(),
        max_fitness=kept.max_fitness,
        mean_fitness=kept.mean_fitness,
        min_fitness=kept.min_fitness,
        best_evaluation=kept.best().evaluation,
    )


def _parser() -> argparse.ArgumentParser:
    parser = ArgumentParser(
        prog="thin",
        description="Thin a repertoire whose elites were re-evaluated: keep those with the greatest mean fitness, "
        "spread over the descriptor space. Writes a folder with the repertoire, the re-evaluations of what is kept, "
        "the actor of dcrl_map_elites, and a card that says where it comes from and what it is good for.",
    )
    parser.add_argument(
        "run", type=user_path, metavar="RUN", help="folder of a run, or repertoire file"
    )
    parser.add_argument(
        "--out",
        type=user_path,
        required=True,
        metavar="FOLDER",
        help="new folder; its name is the repertoire's",
    )
    parser.add_argument(
        "--cells", type=int, default=CELLS, metavar="N", help=f"most behaviors to keep ({CELLS})"
    )
    parser.add_argument(
        "--max-fall-share",
        type=float,
        metavar="SHARE",
        help="keep none of whose re-evaluations more than this share ended in a fall",
    )
    parser.add_argument(
        "--max-spread",
        type=float,
        metavar="SHARE",
        help="keep none whose descriptor has a greater standard deviation, in shares of its range",
    )
    parser.add_argument(
        "--min-fitness",
        type=float,
        default=-math.inf,
        metavar="FITNESS",
        help="keep none with a lower mean fitness",
    )
    parser.add_argument(
        "--remark",
        default="",
        metavar="TEXT",
        help="what else the card is to say, such as the machine",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
