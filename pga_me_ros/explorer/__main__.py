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
from pga_me_ros.explorer.source import Source, StoredSource
from pga_me_ros.paths import user_path
from pga_me_ros.process.program import run_program
from pga_me_ros.tasks.registry import randomization_option

MOTIONS = 64
"""Default number of gaits of a run whose motion is in the file."""

PORT = 8460
"""Default port of the live page."""

ROS_ARGS = "--ros-args"

UNSEEN = 1
"""Default seed of the start that no evaluation had: those of a run are drawn in another way."""


def main(args: Sequence[str] | None = None) -> int:
    """Make a page as the command line says.

    Args:
        args: Command line without the program's name, None for that of this process.

    Returns:
        Exit status, as for `run_program`.
    """
    given = list(sys.argv[1:] if args is None else args)
    cut = given.index(ROS_ARGS) if ROS_ARGS in given else len(given)
    options = _parser().parse_args(given[:cut])
    return run_program(lambda: explore(options, given[cut:]))


def explore(options: argparse.Namespace, ros_args: Sequence[str] = ()) -> None:
    """Carry out a parsed command line.

    Args:
        options: The command line.
        ros_args: ``--ros-args`` and what follows.

    Raises:
        PgaError: What the page needs is not installed, a run cannot be read, the port is taken, or the file cannot be
            written.
    """
    require_web()
    if options.html is None:
        _serve(options, ros_args)
    elif not options.runs:
        raise RequestError("--html writes a stored run; give its folder.")
    else:
        _write(options)


def _write(options: argparse.Namespace) -> None:
    out = _checked(options.html)
    runs = [StoredRun.load(path) for path in options.runs]
    starts = [EpisodeStart(), EpisodeStart(options.seed)]
    if options.randomization:
        randomization_option(runs[0].settings.task, options.randomization)
        starts.append(EpisodeStart(options.seed, options.randomization))
    shown = [
        _recorded(run, str(path), options.motions, tuple(starts))
        for run, path in zip(runs, options.runs, strict=True)
    ]
    title = " and ".join(dict.fromkeys(run.name for run in runs))
    write_page({"title": title, "live": False, "runs": shown}, out)
    print(out)


def _serve(options: argparse.Namespace, ros_args: Sequence[str]) -> None:
    from pga_me_ros.explorer.live import access_for, serve

    sources: list[Source] = [StoredSource(path, str(path)) for path in options.runs]
    if not sources:
        from pga_me_ros.explorer.graph_source import GraphSource

        sources.append(GraphSource(ros_args))
    try:
        title = " and ".join(dict.fromkeys(s.content["run"]["name"] for s in sources))
        access = access_for(options.host, control=options.control, token=options.token)
        serve(sources, options.host, options.port, access, title)
    finally:
        for source in sources:
            source.close()


def _recorded(
    run: StoredRun, name: str, count: int, starts: tuple[EpisodeStart, ...]
) -> dict[str, Any]:
    """Return all that the page shows of a run, and tell what is being recorded."""
    content = describe(run, name)
    recorder = Recorder(run.settings, run.behavior)
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
        nargs="*",
        metavar="RUN",
        help="folder of a run, its repertoire file, or zoo/NAME; two beside each other; none for the running graph",
    )
    parser.add_argument(
        "--html",
        type=user_path,
        metavar="FILE",
        help="write everything into one file instead of serving a page",
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
        help=f"seed of a start that the run has not seen ({UNSEEN})",
    )
    parser.add_argument(
        "--randomization",
        default="",
        metavar="TEXT",
        help="also play each gait in a randomized world, for example 'mass 0.8 1.2, friction 0.6 1.2'",
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="address to serve on (127.0.0.1: this machine only)"
    )
    parser.add_argument("--port", type=int, default=PORT, help=f"port to serve on ({PORT})")
    parser.add_argument(
        "--control",
        action="store_true",
        help="let a page that others can reach pause and stop the run and change its rates",
    )
    parser.add_argument("--token", action="store_true", help="ask for a token on this machine, too")
    return parser


def _not_negative(word: str) -> int:
    number = int(word)
    if number < 0:
        raise argparse.ArgumentTypeError(f"'{word}' is not 0 or more")
    return number


if __name__ == "__main__":
    raise SystemExit(main())
