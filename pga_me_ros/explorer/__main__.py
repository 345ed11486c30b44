"""``ros2 run pga_me_ros explorer RUN``: a page that shows a repertoire and its gaits as they move."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in evaluators

from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.explorer.description import describe
from pga_me_ros.explorer.motion import EpisodeStart
from pga_me_ros.explorer.page import require_web, write_page
from pga_me_ros.explorer.recorder import Recorder, all_motions, chosen_cells
from pga_me_ros.paths import user_path
from pga_me_ros.process.program import run_program

MOTIONS = 64
"""Default number of gaits of a run whose motion is in the file."""

UNSEEN = 1
"""Default seed of the start that no evaluation had: those of a run are drawn in another way."""


def main(args: Sequence[str] | None = None) -> int:
    """Make a page as the command line says.

    Args:
        args: Command line without the program's name, None for that of this process.

    Returns:
        Exit status, as for `run_program`.
    """
    asked = _parser().parse_args(args)
    return run_program(lambda: explore(asked))


def explore(asked: argparse.Namespace) -> None:
    """Carry out a parsed command line.

    Raises:
        PgaError: What the page needs is not installed, a run cannot be read, or the file cannot be written.
    """
    require_web()
    out = _checked(asked.html)
    runs = [StoredRun.load(path) for path in asked.runs]
    starts = [EpisodeStart(), EpisodeStart(asked.seed)]
    if asked.randomization:
        starts.append(EpisodeStart(asked.seed, asked.randomization))
    shown = [
        _recorded(run, str(path), asked.motions, tuple(starts))
        for run, path in zip(runs, asked.runs, strict=True)
    ]
    write_page({"title": _title(runs), "live": False, "runs": shown}, out)
    print(out)


def _recorded(
    run: StoredRun, name: str, count: int, starts: tuple[EpisodeStart, ...]
) -> dict[str, Any]:
    """Return all that the page shows of a run, and tell what is being recorded."""
    content = describe(run, name)
    recorder = Recorder(run)
    cells = chosen_cells(run, count) if recorder.model else []
    motions = {}
    try:
        for cell, motion in all_motions(recorder, cells, starts):
            motions[str(cell)] = motion
            if sys.stderr.isatty():
                print(f"\r{name}: {len(motions)} of {len(cells)} gaits", end="", file=sys.stderr)
    finally:
        recorder.close()
    if motions and sys.stderr.isatty():
        print(file=sys.stderr)
    if recorder.missing:
        print(f"note: {name} has no 3-D view: {recorder.missing}", file=sys.stderr)
    elif len(cells) < len(run.archive):
        print(
            f"note: {len(cells)} of {len(run.archive)} gaits of {name} can be played; --motions takes more along",
            file=sys.stderr,
        )
    return {
        **content,
        "model": recorder.model,
        "model_missing": recorder.missing,
        "starts": [start.key for start in starts],
        "motions": motions,
    }


def _title(runs: Sequence[StoredRun]) -> str:
    return " and ".join(dict.fromkeys(run.name for run in runs))


def _checked(out: Path) -> Path:
    if out.suffix.lower() not in (".html", ".htm") or out.is_dir():
        raise RequestError(f"--html is '{out}'; give the name of a file that ends in .html.")
    if not out.absolute().parent.is_dir():
        raise StorageError(f"There is no folder '{out.absolute().parent}'; make it first.")
    return out


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="explorer", description=__doc__)
    parser.add_argument(
        "runs",
        type=user_path,
        nargs="+",
        metavar="RUN",
        help="folder of a run, its repertoire file, or zoo/NAME; two are shown beside each other",
    )
    parser.add_argument(
        "--html",
        type=user_path,
        required=True,
        metavar="FILE",
        help="file to write, with everything in it",
    )
    parser.add_argument(
        "--motions",
        type=_not_negative,
        default=MOTIONS,
        metavar="N",
        help=f"gaits of each run that can be played, those that differ most ({MOTIONS})",
    )
    parser.add_argument(
        "--seed",
        type=_not_negative,
        default=UNSEEN,
        metavar="N",
        help=f"seed of the start that the run has not seen ({UNSEEN})",
    )
    parser.add_argument(
        "--randomization",
        default="",
        metavar="TEXT",
        help="also play each gait in a changed world, for example 'mass 0.8 1.2, friction 0.6 1.2'",
    )
    return parser


def _not_negative(word: str) -> int:
    number = int(word)
    if number < 0:
        raise argparse.ArgumentTypeError(f"'{word}' is not 0 or more")
    return number


if __name__ == "__main__":
    raise SystemExit(main())
