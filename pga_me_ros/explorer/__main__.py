"""``ros2 run pga_me_ros explorer RUN``: a page that shows a repertoire and its gaits as they move."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in evaluators

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.core.storage.distinct import require_distinct
from pga_me_ros.core.storage.files import require_writable
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError
from pga_me_ros.explorer.description import describe
from pga_me_ros.explorer.motion import EpisodeStart
from pga_me_ros.explorer.page import require_web, write_page
from pga_me_ros.explorer.recorder import Recorder, all_motions, chosen_cells
from pga_me_ros.explorer.source import Source, StoredSource
from pga_me_ros.paths import user_path
from pga_me_ros.process.program import run_program
from pga_me_ros.tasks.registry import damage_option, randomization_option

MOTIONS = 64
"""Default number of gaits of a run whose motion is in the file."""

HOST = "127.0.0.1"
"""Default address of the live page, which only this machine reaches."""

PORT = 8460
"""Default port of the live page."""

ROS_ARGS = "--ros-args"

OF_THE_FILE = ("motions", "seed", "randomization", "damage")
OF_THE_PAGE = ("host", "port", "control", "token")
"""Options that only one of both has a use for."""

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
        PgaError: What the page needs is not installed, a run cannot be read or is given twice, more than two are
            named, the port is taken, or the file cannot be written.
    """
    require_web()
    _require_use(options)
    _require_two_at_most(options)
    if options.html is None:
        _serve(options, ros_args)
    elif options.graph or not options.runs:
        raise RequestError("--html writes stored runs only; give their folders, and no --graph.")
    elif ros_args:
        raise RequestError(
            f"'{' '.join(ros_args)}' is for a graph, but --html writes stored runs only; leave it out."
        )
    else:
        _write(options)


def _require_use(options: argparse.Namespace) -> None:
    """Refuse options that the page, or the file, has no use for.

    Raises:
        RequestError: There is one.
    """
    useless = OF_THE_FILE if options.html is None else OF_THE_PAGE
    for name in useless:
        given = getattr(options, name)
        if given is not None and given is not False:
            where = "only with --html" if options.html is None else "not with --html"
            raise RequestError(f"--{name} has a meaning {where}; leave it out.")


def _require_two_at_most(options: argparse.Namespace) -> None:
    """Refuse more than stand beside each other.

    Raises:
        RequestError: There are more than two.
    """
    named = len(options.runs) + len(options.graph)
    if named > 2:
        raise RequestError(f"{named} are named, but a page shows one or two; leave the others out.")


def _write(options: argparse.Namespace) -> None:
    out = options.html
    require_writable(out, (".html", ".htm"), "--html")
    runs = [StoredRun.load(path) for path in options.runs]
    require_distinct(runs)
    seed = UNSEEN if options.seed is None else options.seed
    motions = MOTIONS if options.motions is None else options.motions
    starts = [EpisodeStart(), EpisodeStart(seed)]
    if options.randomization:
        for run in runs:
            randomization_option(run.settings.task, options.randomization)
        starts.append(EpisodeStart(seed, options.randomization))
    if options.damage:
        for run in runs:
            damage_option(run.settings.task, options.damage)
        starts.append(EpisodeStart(seed, damage=options.damage))
    shown = [
        _recorded(run, str(path), motions, tuple(starts))
        for run, path in zip(runs, options.runs, strict=True)
    ]
    title = " and ".join(dict.fromkeys(run.name for run in runs))
    write_page({"title": title, "live": False, "runs": shown}, out)
    print(out)


def _serve(options: argparse.Namespace, ros_args: Sequence[str]) -> None:
    from pga_me_ros.explorer.live import access_for, serve

    stored = [StoredSource(path, str(path)) for path in options.runs]
    require_distinct(source.run for source in stored)
    sources: list[Source] = [*stored]
    if options.graph or not sources:
        from pga_me_ros.explorer.graph_source import open_graphs

        sources += open_graphs(options.graph, ros_args)
    elif ros_args:
        raise RequestError(
            f"'{' '.join(ros_args)}' is for a graph, but only stored runs are named; add --graph NAMESPACE or leave it "
            "out."
        )
    try:
        title = " and ".join(dict.fromkeys(s.content["run"]["name"] for s in sources))
        host = options.host or HOST
        port = PORT if options.port is None else options.port
        serve(
            sources,
            host,
            port,
            access_for(host, control=options.control, token=options.token),
            title,
        )
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


def _parser() -> argparse.ArgumentParser:
    parser = ArgumentParser(prog="explorer", description=__doc__)
    parser.add_argument(
        "runs",
        type=user_path,
        nargs="*",
        metavar="RUN",
        help="folder of a run, its repertoire file, or zoo/NAME; two beside each other; none for the running graph",
    )
    parser.add_argument(
        "--graph",
        action="append",
        default=[],
        metavar="NAMESPACE",
        help="show the graph of a namespace, / for that without one; may be given twice, or beside a RUN",
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
        metavar="N",
        help=f"gaits of each run that can be played, those that differ most ({MOTIONS})",
    )
    parser.add_argument(
        "--seed",
        type=_not_negative,
        metavar="N",
        help=f"seed of a start that the run has not seen ({UNSEEN})",
    )
    parser.add_argument(
        "--randomization",
        metavar="TEXT",
        help="also play each gait in a randomized world, for example 'mass 0.8 1.2, friction 0.6 1.2'",
    )
    parser.add_argument(
        "--damage",
        metavar="TEXT",
        help="also play each gait on a damaged robot, for example 'load 2'",
    )
    parser.add_argument(
        "--host", help=f"address to serve on ({HOST}, which only this machine reaches)"
    )
    parser.add_argument("--port", type=int, help=f"port to serve on ({PORT})")
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
