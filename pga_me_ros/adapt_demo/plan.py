"""The command line of the demonstration, checked before anything is started or written."""

from __future__ import annotations

import argparse
import dataclasses
import shlex
from collections.abc import Sequence
from pathlib import Path

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.core.adaptation.adaptation_settings import AdaptationSettings
from pga_me_ros.core.archive.worlds import Worlds
from pga_me_ros.core.settings.field import checked_value
from pga_me_ros.core.storage.files import require_writable
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError
from pga_me_ros.paths import user_path
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import damage_option, make_task

REPERTOIRE = "zoo/qd_hopper"
DAMAGE = "ice 0.25"

DEFAULTS = AdaptationSettings(budget=15)

ENDINGS = (".png", ".svg", ".pdf")


@dataclasses.dataclass(frozen=True)
class Plan:
    """What is to be shown.

    Attributes:
        name: The repertoire as the command line has it.
        run: The repertoire.
        damage: What becomes wrong with its robot.
        settings: How behaviors are chosen.
        worlds: Other worlds that the robot may be in, None for none.
        repeat: Which initial poses and draws it is shown with.
        out: File of the picture.
    """

    name: str
    run: StoredRun
    damage: str
    settings: AdaptationSettings
    worlds: Worlds | None
    repeat: int
    out: Path

    @classmethod
    def read(cls, args: Sequence[str] | None = None) -> Plan:
        """Read a command line.

        Args:
            args: The words without the program's name, None for those of this process.

        Raises:
            PgaError: The repertoire cannot be read, its robot cannot have that damage, a number makes no sense, or the
                picture could not be written.
        """
        options = _parser().parse_args(args)
        given = vars(options)
        settings = {
            f.name: checked_value(f, given[f.name])
            for f in dataclasses.fields(AdaptationSettings)
            if f.name in given
        }
        if options.repeat < 0:
            raise RequestError(f"--repeat is {options.repeat}; give 0 or more.")
        require_writable(options.out, ENDINGS)
        run, damage = StoredRun.load(options.repertoire), options.damage.strip()
        if not damage:
            raise RequestError(
                f"--damage is empty; say what is wrong with the robot, such as '{DAMAGE}'."
            )
        damage_option(run.settings.task, damage)
        return cls(
            str(options.repertoire),
            run,
            damage,
            AdaptationSettings(**settings),
            _worlds(run, options.worlds),
            options.repeat,
            options.out,
        )

    def task(self, damage: str = "") -> Task:
        """Return the robot's task, sound or damaged."""
        stored = self.run.settings
        return make_task(stored.task, stored.randomization, damage)

    def watch(self, cell: int) -> str:
        """Return the command that draws what a gait does on the damaged robot."""
        words = [self.name, "--cell", str(cell), "--damage", self.damage, "--seed", "1"]
        return f"ros2 run pga_me_ros render {shlex.join(words)} --out gait.gif"


def _worlds(run: StoredRun, wanted: bool | None) -> Worlds | None:
    """Return the worlds that a robot may be in: those of its repertoire, None if they are not wanted.

    Raises:
        RequestError: They are wanted, but there are none.
    """
    if wanted:
        return run.require_worlds("--worlds")
    return run.worlds if wanted is None else None


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        prog="adapt_demo",
        description="A robot is damaged, tries a few gaits of its repertoire, and walks again.",
    )
    parser.add_argument(
        "repertoire",
        nargs="?",
        type=user_path,
        default=user_path(REPERTOIRE),
        help=f"folder of a run, its repertoire file, or a shipped repertoire ({REPERTOIRE})",
    )
    parser.add_argument(
        "--damage",
        default=DAMAGE,
        metavar="TEXT",
        help=f"what becomes wrong with the robot or its world ({DAMAGE}); docs/adaptation.md has the kinds",
    )
    budget, scale = DEFAULTS.budget, DEFAULTS.length_scale
    parser.add_argument(
        "--budget", type=int, default=budget, metavar="N", help=f"most trials ({budget})"
    )
    parser.add_argument(
        "--length-scale",
        type=float,
        default=scale,
        metavar="X",
        help="distance over which gaits tell about each other, in shares of the descriptor's range "
        f"({scale}, the paper's)",
    )
    parser.add_argument(
        "--least-length-scale",
        type=float,
        default=0.0,
        metavar="X",
        help="above 0, the length scale is inferred from the trials, between this one and --length-scale (0)",
    )
    parser.add_argument(
        "--worlds",
        action=argparse.BooleanOptionalAction,
        help="whether the robot may be in other worlds that the gaits were evaluated in (if there are any)",
    )
    parser.add_argument(
        "--repeat",
        type=int,
        default=0,
        metavar="N",
        help="another number draws other initial poses for the trials (0)",
    )
    parser.add_argument(
        "--out",
        type=user_path,
        default=Path("adapt_demo.png"),
        metavar="FILE",
        help="picture to write (adapt_demo.png)",
    )
    return parser
