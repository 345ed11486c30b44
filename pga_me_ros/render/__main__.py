"""``ros2 run pga_me_ros render RUN``: a stored gait as an animated GIF, or many of them in one picture."""

from __future__ import annotations

import argparse
import io
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in evaluators

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.core.archive.choosing import Demands, Judging
from pga_me_ros.core.storage.files import require_writable, save_bytes
from pga_me_ros.core.storage.stored_run import StoredBehavior, StoredRun
from pga_me_ros.errors import RequestError
from pga_me_ros.paths import user_path
from pga_me_ros.player.gait import Gait
from pga_me_ros.player.promise import kept, lasted
from pga_me_ros.player.recorded_gait import evaluated_again
from pga_me_ros.player.watched_rollout import Recording
from pga_me_ros.process.command_words import is_number, positionals_first
from pga_me_ros.process.program import run_program
from pga_me_ros.render.behavior_gif import (
    GifOptions,
    draw_gallery,
    draw_gif,
    require_pillow,
)
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import Episode

MOMENTS = 8
"""Default number of moments per gait of a sheet."""

MOST_COLUMNS = 100

OF_A_GIF = ("start", "seconds", "speed", "fps", "size")
"""Options that a sheet has no use for."""

SIDE_BY_SIDE = 3
"""Default number of gaits in a row of a gallery."""


def main(args: Sequence[str] | None = None) -> int:
    """Draw a picture as the command line says, and print the name of the file.

    Args:
        args: Command line without the program's name, None for that of this process.

    Returns:
        Exit status, as for `run_program`.
    """
    words = sys.argv[1:] if args is None else args
    options = _parser().parse_args(positionals_first(words, "--descriptor", is_number))
    return run_program(lambda: print(render(options)))


def render(options: argparse.Namespace) -> Path:
    """Carry out a parsed command line.

    Returns:
        The file that was written.

    Raises:
        PgaError: The run cannot be read, has no such gait, its task cannot be drawn, or the file cannot be written.
    """
    require_pillow()
    _require_use(options)
    gif = _gif_options(options)
    run = StoredRun.load(options.run)
    if run.archive.note:
        print(f"note: {run.archive.note}", file=sys.stderr)
    ending = ".png" if options.sheet else ".gif"
    out = options.out or Path(f"{run.name}{'-gaits' if options.sheet else ''}{ending}")
    require_writable(out, [ending])
    task = make_task(run.settings.task, run.settings.randomization, options.damage)
    try:
        if options.sheet:
            _draw_sheet(options, run, task, out)
        elif options.gallery:
            _draw_gallery(options, run, task, out, gif)
        else:
            _draw_animation(options, run, task, out, gif)
    finally:
        task.close()
    return out


def _require_use(options: argparse.Namespace) -> None:
    """Refuse options that the picture has no use for, and too many columns.

    Raises:
        RequestError: There is one.
    """
    for name in OF_A_GIF if options.sheet else ():
        if getattr(options, name) is not None:
            raise RequestError(f"--{name} is about a GIF, but --sheet draws a PNG; leave it out.")
    if options.columns is None:
        return
    if not options.sheet and not options.gallery:
        raise RequestError("--columns is about --sheet and --gallery; leave it out.")
    if options.columns > MOST_COLUMNS:
        raise RequestError(f"--columns is {options.columns}; give 1 to {MOST_COLUMNS}.")


def _draw_animation(
    options: argparse.Namespace, run: StoredRun, task: Task, out: Path, gif: GifOptions
) -> None:
    gait = run.choose(
        descriptor=options.descriptor,
        cell=options.cell,
        random=options.random,
        min_fitness=options.min_fitness,
        max_fall_share=options.max_fall_share,
        single=options.single,
    )
    episode = draw_gif(task, run.settings, gait, out, gif)
    _tell(gait, episode, options.seed, task.spec.control_period)


def _draw_gallery(
    options: argparse.Namespace, run: StoredRun, task: Task, out: Path, gif: GifOptions
) -> None:
    gaits = _spread(options, run, options.gallery)
    columns = options.columns or SIDE_BY_SIDE
    episodes = draw_gallery(task, run.settings, gaits, out, gif, columns)
    for gait, episode in zip(gaits, episodes, strict=True):
        _tell(gait, episode, options.seed, task.spec.control_period)


def _gif_options(options: argparse.Namespace) -> GifOptions:
    given = {name: getattr(options, name) for name in OF_A_GIF}
    if options.size:
        given["size"] = tuple(options.size)
    return GifOptions(
        seed=options.seed, **{name: value for name, value in given.items() if value is not None}
    )


def _spread(options: argparse.Namespace, run: StoredRun, count: int) -> list[StoredBehavior]:
    """Choose gaits that lie far apart in the descriptor space, of those that meet the demands."""
    from pga_me_ros.core.archive.spread import spread_cells

    demands = Demands(
        Judging.of(single=options.single),
        -math.inf if options.min_fitness is None else options.min_fitness,
        math.inf if options.max_fall_share is None else options.max_fall_share,
    )
    choices = run.choices(demands)
    cells = spread_cells(choices.elites, choices.cells(), count)
    return [StoredBehavior.chosen(choices, cell, run.shape) for cell in cells]


def _draw_sheet(options: argparse.Namespace, run: StoredRun, task: Task, out: Path) -> None:
    from pga_me_ros.render.contact_sheet import Row, contact_sheet, sheet_size

    gaits = _spread(options, run, options.sheet)
    columns = options.columns or MOMENTS
    sheet_size(len(gaits), columns)  # refuses too many before their episodes are run
    rows = [Row(gait, _recorded(run, task, gait, options.seed)) for gait in gaits]
    names = ", ".join(run.spec.descriptor_names)
    title = f"{run.spec.name}: {len(rows)} of {len(run.archive)} gaits, described by [{names}]"
    sheet = contact_sheet(title, rows, columns, task.spec.control_period)
    content = io.BytesIO()
    sheet.save(content, format="PNG", optimize=True)
    save_bytes(out, content.getvalue())


def _recorded(run: StoredRun, task: Task, gait: Gait, seed: int | None) -> Recording:
    """Run a gait's evaluation again, or another episode of it, and say how the result compares."""
    recording = evaluated_again(task, run.settings, gait, 1, seed)
    _tell(gait, recording.episode, seed, task.spec.control_period)
    return recording


def _tell(gait: Gait, episode: Episode, seed: int | None, period: float) -> None:
    told = f"{kept(gait, episode, fresh=seed is not None)}; {lasted(episode, period)}"
    print(f"cell {gait.cell}: {told}", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    parser = ArgumentParser(prog="render", description=__doc__)
    parser.add_argument("run", type=user_path, help="folder of a run, or its repertoire file")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--best", action="store_true", help="draw the fittest gait (the default)")
    which.add_argument(
        "--descriptor", type=float, nargs="+", metavar="X", help="draw the nearest gait"
    )
    which.add_argument("--cell", type=int, help="draw the gait of a cell")
    which.add_argument("--random", action="store_true", help="draw any gait")
    which.add_argument(
        "--sheet", type=_at_least_one, metavar="N", help="draw N gaits that differ, in one PNG"
    )
    which.add_argument(
        "--gallery",
        type=_at_least_one,
        metavar="N",
        help="draw N gaits that differ, side by side in one GIF",
    )
    parser.add_argument("--min-fitness", type=float, help="only gaits of this fitness or more")
    parser.add_argument(
        "--max-fall-share",
        type=float,
        metavar="SHARE",
        help="only gaits of whose re-evaluations at most this share ended in a fall",
    )
    parser.add_argument(
        "--single",
        action="store_true",
        help="choose by the single evaluation that gaits were found with, not by the means of their re-evaluations",
    )
    parser.add_argument(
        "--seed",
        type=_not_negative,
        metavar="N",
        help="begin in another initial pose, drawn from this seed, not in that of the gait's evaluation",
    )
    parser.add_argument(
        "--damage",
        default="",
        metavar="TEXT",
        help="what is wrong with the robot or its world: 'jam foot_joint 0.3, ice' (docs/adaptation.md)",
    )
    parser.add_argument("--out", type=user_path, help="file to write; a GIF, or a PNG with --sheet")
    usual = GifOptions()
    for name, words in (
        ("start", "seconds to leave out"),
        ("seconds", "seconds to show"),
        ("speed", "speed, 1 is real time"),
        ("fps", "pictures per second"),
    ):
        default = getattr(usual, name)
        parser.add_argument(f"--{name}", type=float, help=f"{words} (GIF; {default:g})")
    parser.add_argument(
        "--size",
        type=int,
        nargs=2,
        metavar=("WIDTH", "HEIGHT"),
        help="pixels (GIF; {} {})".format(*usual.size),
    )
    parser.add_argument(
        "--columns",
        type=_at_least_one,
        help=f"moments per gait of a sheet ({MOMENTS}), gaits per row of a gallery ({SIDE_BY_SIDE})",
    )
    return parser


def _at_least_one(word: str) -> int:
    number = int(word)
    if number < 1:
        raise argparse.ArgumentTypeError(f"'{word}' is not 1 or more")
    return number


def _not_negative(word: str) -> int:
    number = int(word)
    if number < 0:
        raise argparse.ArgumentTypeError(f"'{word}' is not 0 or more")
    return number


if __name__ == "__main__":
    raise SystemExit(main())
