"""``ros2 run pga_me_ros replay BAG``: trains critics on a recording, restores a run from it, or publishes it again."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Sequence
from dataclasses import Field, fields
from typing import Any

import yaml

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.core.algorithms import ALGORITHMS, algorithm_of
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.rules import CRITICS
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, SettingsError
from pga_me_ros.paths import user_path
from pga_me_ros.process.program import run_program
from pga_me_ros.recording.episodes import RecordedRun, recorded_run
from pga_me_ros.recording.gaps import ranges
from pga_me_ros.replay.publishing import publish
from pga_me_ros.replay.restoring import restore_experience
from pga_me_ros.tasks.registry import task_spec

ROS_ARGS = "--ros-args"

OF_NETWORKS = ("task", "seed", "controller_hidden")
"""Settings that a training takes from another run, besides those of its critics."""

TIMING = ("schedule", "critic_start")
"""Settings of critics that decide when they are trained, which do not apply to a recording."""

STEPS = 3000
"""Default number of training steps."""

RATE = 1.0
"""Default speed of publishing, relative to the recording."""

WAIT = 5.0
"""Default seconds to wait for a subscriber."""

USES = {
    "--out": ("steps", "task", "like", "set", "run_id", "incomplete"),
    "--into": (),
    "--publish": ("rate", "wait"),
}
"""What can be done with a recording, and the options of each; what is not given is None."""


def main(args: Sequence[str] | None = None) -> int:
    """Process a recording as the command line says, and print what was done.

    Args:
        args: Command line without the program's name, None for that of this process.

    Returns:
        Exit status, as `run_program`.
    """
    given = list(sys.argv[1:] if args is None else args)
    cut = given.index(ROS_ARGS) if ROS_ARGS in given else len(given)
    options = _parser().parse_args(given[:cut])

    def work() -> None:
        _require_use(options, given[cut:])
        if options.publish:
            rate = RATE if options.rate is None else options.rate
            wait = WAIT if options.wait is None else options.wait
            print(publish(options.bag, rate, wait, given[cut:]))
        elif options.into:
            print(restore_experience(options.bag, options.into))
        else:
            print(train(options))

    return run_program(work)


def _require_use(options: argparse.Namespace, ros_args: Sequence[str]) -> None:
    """Refuse options for something else than what is to be done.

    Raises:
        RequestError: There is one.
    """
    use = "--publish" if options.publish else "--into" if options.into else "--out"
    given = [
        (f"--{name.replace('_', '-')}", other)
        for other, names in USES.items()
        for name in names
        if getattr(options, name) is not None
    ]
    if ros_args:
        given.append((" ".join(ros_args), "--publish"))
    for words, other in given:
        if other != use:
            raise RequestError(
                f"'{words}' has a meaning only with {other}, not with {use}; leave it out."
            )


def train(options: argparse.Namespace) -> str:
    """Train critics as a parsed command line says.

    Returns:
        The outcome, as text.

    Raises:
        PgaError: The recording or a setting is invalid.
    """
    recorded = recorded_run(options.bag, options.run_id or "")
    settings = _settings(options, recorded)
    _require_sound(recorded, settings, options)
    spec = task_spec(settings.task)
    from pga_me_ros.replay.training import (
        train_critics,
    )  # torch takes seconds to import, so errors come first

    done = train_critics(recorded, spec, settings, options.out)
    first, last = done["evaluations"]
    return (
        f"trained {done['steps']} steps on {done['transitions']} transitions of {done['episodes']} episodes "
        f"(evaluations {first} to {last}): critic loss {done['critic_loss']:.4g}, mean Q {done['mean_q']:.4g}; "
        f"in '{options.out}'"
    )


def _settings(options: argparse.Namespace, recorded: RecordedRun) -> Settings:
    """Return the settings of the training: defaults or those of a run, changed by the command line.

    Raises:
        SettingsError: A value is invalid.
        StorageError: The run cannot be read.
    """
    changes = _changes(options.set or ())
    if options.task is not None:
        if "task" in changes:
            raise SettingsError("--task and --set task are both given; leave one of them out.")
        changes["task"] = options.task
    base: dict[str, Any] = {"task": recorded.task}
    if options.like:
        base = _of_critics(StoredRun.load(options.like, elites=False).settings)
    algorithm = ALGORITHMS.get(str(changes.get("algorithm")))
    if algorithm and not algorithm.learns_critics:
        raise SettingsError(f"{algorithm.name} learns no critics; remove --set algorithm.")
    steps = STEPS if options.steps is None else options.steps
    if steps < 1:  # for n_crit, 0 stands for the algorithm's own number
        raise SettingsError(f"--steps is {steps}; give n_crit, the steps to train, 1 or more.")
    settings = Settings.from_mapping({**base, **changes, "n_crit": steps})
    if settings.greedy_init != "random":
        raise SettingsError(
            f"greedy_init is '{settings.greedy_init}', but a recording has no archive; add --set greedy_init=random."
        )
    return settings


def _of_critics(like: Settings) -> dict[str, Any]:
    """Return the settings with which a run's critics were trained, by name.

    Raises:
        SettingsError: The run trains no critics.
    """
    algorithm = algorithm_of(like)
    if not algorithm.learns_critics:
        raise SettingsError(f"{like.algorithm} learns no critics; remove --like.")
    names, parts = [*OF_NETWORKS], [*CRITICS]
    if algorithm.conditioned:  # its critics take other inputs and rewards
        names.append("algorithm")
        parts.append(algorithm.name)
    return {f.name: getattr(like, f.name) for f in fields(Settings) if _counts(f, names, parts)}


def _counts(f: Field[Any], names: Sequence[str], parts: Sequence[str]) -> bool:
    return f.name in names or (f.metadata["part"] in parts and f.name not in TIMING)


def _changes(texts: Sequence[str]) -> dict[str, Any]:
    """Return the settings that ``--set`` gives, by name.

    Raises:
        SettingsError: One has no value, is given twice, or has no effect on the training.
    """
    changes: dict[str, Any] = {}
    names, parts = (*OF_NETWORKS, "algorithm"), (*CRITICS, *ALGORITHMS)
    useless = {f.name for f in fields(Settings) if not _counts(f, names, parts)}
    for name, value in map(_assignment, texts):
        if name in changes:
            raise SettingsError(f"--set {name} is given twice; leave one of them out.")
        if name == "n_crit":
            raise SettingsError("--set n_crit is the number of steps; give it by --steps.")
        if name in useless:
            raise SettingsError(
                f"--set {name} has no effect on the training of critics on a recording; leave it out."
            )
        changes[name] = value
    return changes


def _assignment(text: str) -> tuple[str, Any]:
    name, equals, value = text.partition("=")
    if not equals:
        raise SettingsError(f"--set {text} has no value; write --set NAME=VALUE.")
    try:
        parsed = yaml.safe_load(value)
    except yaml.YAMLError:
        raise SettingsError(f"--set {text} has a value that is not valid YAML.") from None
    if isinstance(parsed, str):  # YAML reads 1e-4 as a string
        with contextlib.suppress(ValueError):
            parsed = float(parsed)
    return name, tuple(parsed) if isinstance(parsed, list) else parsed


def _require_sound(recorded: RecordedRun, settings: Settings, options: argparse.Namespace) -> None:
    """Make sure that the recording is of the task and complete.

    Raises:
        RequestError: It is of another task, or episodes are missing and --incomplete is not given.
    """
    if recorded.task != settings.task:
        raise RequestError(
            f"'{options.bag}' was recorded with task '{recorded.task}', but the critics are for '{settings.task}'; "
            "remove --task and --like, or give those of that task."
        )
    if recorded.differing:
        print(
            f"note: {len(recorded.differing)} evaluations were recorded with different outcomes, as when a generation "
            f"is repeated; the last ones count: {ranges(recorded.differing)}",
            file=sys.stderr,
        )
    if recorded.missing:
        lost = (
            f"{len(recorded.missing)} episodes are missing: evaluations {ranges(recorded.missing)}"
        )
        if not options.incomplete:
            raise RequestError(
                f"'{options.bag}' is not complete; {lost}. --incomplete trains on the rest."
            )
        print(f"note: {lost}", file=sys.stderr)


def _parser() -> ArgumentParser:
    parser = ArgumentParser(
        prog="replay",
        description="Use a recording of a run's experience: train critics on it, restore experience files that the run "
        "has lost, or publish its messages again.",
    )
    parser.add_argument("bag", type=user_path, metavar="BAG", help="folder that `record` made")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--out",
        type=user_path,
        metavar="FOLDER",
        help="train critics and write them into this new folder",
    )
    what.add_argument(
        "--into", type=user_path, metavar="RUN", help="restore lost experience files of this run"
    )
    what.add_argument(
        "--publish", action="store_true", help=f"publish; ROS arguments follow after {ROS_ARGS}"
    )
    training = parser.add_argument_group("training")
    training.add_argument("--steps", type=int, metavar="N", help=f"({STEPS})")
    training.add_argument("--task", help="refuse a recording of any other task")
    training.add_argument(
        "--like",
        type=user_path,
        metavar="RUN",
        help="use the settings of this run instead of the defaults",
    )
    training.add_argument(
        "--set", action="append", metavar="NAME=VALUE", help="a setting, such as seed=3"
    )
    training.add_argument("--run-id", metavar="ID", help="which run, if there are several")
    training.add_argument(
        "--incomplete",
        action="store_true",
        default=None,
        help="train even if episodes are missing",
    )
    publishing = parser.add_argument_group("publishing")
    publishing.add_argument(
        "--rate",
        type=float,
        help=f"speed relative to the recording; 0: without pauses ({RATE:g})",
    )
    publishing.add_argument(
        "--wait",
        type=float,
        metavar="SECONDS",
        help=f"how long to wait for a subscriber ({WAIT:g})",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
