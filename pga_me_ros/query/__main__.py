"""``ros2 run pga_me_ros query --descriptor 0.9 0.1``: asks the repertoire that is served for behaviors."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.client import Behavior, FoundBehavior, RepertoireClient, RepertoireInfo
from pga_me_ros.errors import RequestError
from pga_me_ros.paths import user_path
from pga_me_ros.process.program import run_program
from pga_me_ros.query.saving import require_savable, save
from pga_me_ros.query.table import as_json, table
from pga_me_ros.ros.command_line import Program, start
from pga_me_ros.ros.spinning import EndingNode

ROS_ARGS = "--ros-args"

PROGRAM = Program("query", "Asks a repertoire for behaviors.", ())


def main(args: Sequence[str] | None = None) -> int:
    """Ask for what the command line says, and print what was found.

    Args:
        args: Command line without the program's name, None for the process's own.

    Returns:
        Exit status, as `run_program`: 2 also where no behavior fits.
    """
    given = list(sys.argv[1:] if args is None else args)
    cut = given.index(ROS_ARGS) if ROS_ARGS in given else len(given)
    options = _parser().parse_args(given[:cut])
    return run_program(lambda: print(query(options, given[cut:])))


def query(options: argparse.Namespace, ros_args: Sequence[str]) -> str:
    """Carry out a parsed command line.

    Args:
        options: The command line.
        ros_args: ``--ros-args`` and what follows, for example a namespace.

    Returns:
        What was found, as a table or as JSON.

    Raises:
        PgaError: No behavior fits, nobody serves a repertoire, the request makes no sense, or the file cannot be
            written.
    """
    _require_sense(options)
    if options.save:
        require_savable(options.save)
    with client(ros_args, options.timeout) as repertoire:
        found, info = ask(repertoire, options)
        if options.save:
            (behavior,) = found
            assert isinstance(behavior, Behavior)
            save(behavior, info, options.save)
    text = as_json(found, info) if options.json else table(found, info)
    return text if options.json or not options.save else f"{text}\nsaved: {options.save}"


def ask(
    repertoire: RepertoireClient, options: argparse.Namespace
) -> tuple[Sequence[FoundBehavior], RepertoireInfo]:
    """Ask for the behaviors, and what the repertoire is."""
    limits: dict[str, Any] = {
        "min_fitness": options.min_fitness,
        "max_fall_share": options.max_fall_share,
        "by_mean": options.by_mean,
        "single": options.single,
    }
    info = repertoire.get_info()
    if options.descriptor is not None:
        limits["max_distance"] = options.max_distance
    if options.count > 1:
        return repertoire.find_behaviors(options.descriptor, options.count, **limits), info
    way: dict[str, Any] = {"best": True}
    if options.descriptor is not None:
        way = {"descriptor": options.descriptor}
    elif options.cell is not None:
        way = {"cell": options.cell}
    elif options.random:
        way = {"random": True}
    get = repertoire.get_behavior if options.save else repertoire.find_behavior
    return [get(**way, **limits)], info


@contextmanager
def client(ros_args: Sequence[str], timeout: float) -> Iterator[RepertoireClient]:
    """Provide a client on a node of its own."""
    start(PROGRAM, list(ros_args), signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = EndingNode("query")
        try:
            yield RepertoireClient(node, timeout=timeout)
        finally:
            node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _require_sense(options: argparse.Namespace) -> None:
    """Refuse options that would be ignored.

    Raises:
        RequestError: An option has no use for the way in which the behavior is chosen, or a number makes no sense.
    """
    if options.count < 1:
        raise RequestError(f"-k is {options.count}; give 1 or more.")
    if options.descriptor is None:
        for name, is_given in (
            ("-k", options.count > 1),
            ("--max-distance", options.max_distance is not None),
        ):
            if is_given:
                raise RequestError(f"{name} needs --descriptor: it is about the nearest behaviors.")
    if options.save and options.count > 1:
        raise RequestError("--save writes one behavior; leave out -k, or choose one by --cell.")


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        prog="query",
        description="Ask the repertoire that a run or an archive_manager serves for behaviors, and print them as a "
        f"short table. ROS arguments follow after {ROS_ARGS}, for example -r __ns:=/left.",
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--best", action="store_true", help="the fittest behavior (the default)")
    which.add_argument(
        "--descriptor", type=float, nargs="+", metavar="X", help="the behavior nearest to it"
    )
    which.add_argument("--cell", type=int, metavar="N", help="the behavior of this cell")
    which.add_argument("--random", action="store_true", help="any behavior")
    parser.add_argument(
        "-k",
        "--count",
        type=int,
        default=1,
        metavar="K",
        help="the K nearest behaviors, with --descriptor (1)",
    )
    parser.add_argument(
        "--max-distance",
        type=float,
        metavar="D",
        help="none farther from the descriptor, each dimension in shares of its range",
    )
    parser.add_argument("--min-fitness", type=float, metavar="F", help="none less fit")
    parser.add_argument(
        "--max-fall-share",
        type=float,
        metavar="SHARE",
        help="none of whose re-evaluations more than this share ended in a fall, 0 to 1",
    )
    judged = parser.add_mutually_exclusive_group()
    judged.add_argument(
        "--by-mean", action="store_true", help="leave out behaviors that were not re-evaluated"
    )
    judged.add_argument(
        "--single",
        action="store_true",
        help="judge all by the evaluation that they were found with",
    )
    parser.add_argument("--json", action="store_true", help="print JSON in place of the table")
    parser.add_argument(
        "--save",
        type=user_path,
        metavar="FILE",
        help="also write the behavior: FILE.onnx, FILE.npz or FILE.pt (TorchScript)",
    )
    parser.add_argument(
        "--timeout",
        type=float,
        default=10.0,
        metavar="S",
        help="seconds to wait for an answer (10)",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
