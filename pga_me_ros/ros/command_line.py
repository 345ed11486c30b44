"""Command lines of the nodes: help without starting ROS 2, and every mistake reported in one line."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import rclpy
import yaml
from rclpy._rclpy_pybind11 import UnknownROSArgsError
from rclpy.logging import LoggingSeverity, get_logger_level, set_logger_level

from pga_me_ros.errors import SettingsError, nearest_name
from pga_me_ros.paths import expanded
from pga_me_ros.process.collection import resume_collection
from pga_me_ros.process.early_signals import hand_over
from pga_me_ros.process.streams import tell
from pga_me_ros.ros.environment import prepare_environment
from pga_me_ros.ros.memory import set_malloc_limits
from pga_me_ros.ros.node_names import EXPECTED, RENAMES_NODE, require_valid_name
from pga_me_ros.ros.parameter_help import parameter_list
from pga_me_ros.ros.parameters import is_ros_own
from pga_me_ros.ros.params_file import entries, matches

HELP = ("-h", "--help")
REMAP = ("-r", "--remap")
PARAM = ("-p", "--param")


@dataclass(frozen=True)
class Program:
    """Description of a node's executable.

    Attributes:
        name: Executable and default node name.
        summary: One sentence on what it does.
        parameters: Settings dataclasses whose fields are its parameters.
    """

    name: str
    summary: str
    parameters: tuple[type, ...]

    def help(self) -> str:
        """Return the text for ``--help``."""
        return (
            f"Usage: {self.name} [--help] [--ros-args [-p NAME:=VALUE]... [--params-file FILE] "
            f"[-r __ns:=/NAMESPACE]]\n\n{self.summary}\n\n"
            f"Parameters (* can be set while it runs):\n\n{parameter_list(*self.parameters)}"
        )


def start(program: Program, args: Sequence[str] | None = None, **options: Any) -> bool:
    """Check the command line, then initialize ROS 2, or print the help.

    Args:
        program: The executable.
        args: Command line without the program's name; None for that of this process.
        options: Further arguments of ``rclpy.init``.

    Returns:
        Whether ROS 2 was initialized, so that the node should run.

    Raises:
        SettingsError: An argument, a params file or the environment is invalid.
    """
    resume_collection()
    args = list(sys.argv[1:] if args is None else args)
    if program.parameters and any(word in HELP for word in args):  # others have a help of options
        tell(program.help(), end="")
        return False
    for i, (flag, value) in enumerate(pairwise(args), start=1):
        if flag == "--params-file":
            args[i] = expanded(value)
    check(program, args)
    prepare_environment()
    set_malloc_limits()
    if "signal_handler_options" not in options:  # otherwise the caller handles signals itself
        hand_over()
    try:
        # What rcl logs about bad arguments is also in its error, which is turned into a readable message.
        set_logger_level("rcl", LoggingSeverity.FATAL)
        rclpy.init(args=[program.name, *args], **options)
    except RuntimeError as error:
        raise SettingsError(_in_words(error)) from None
    finally:
        if get_logger_level("rcl") == LoggingSeverity.FATAL:
            set_logger_level("rcl", LoggingSeverity.UNSET)
    return True


def check(program: Program, args: Sequence[str]) -> None:
    """Refuse arguments that ROS 2 would ignore or report in terms of its source code.

    Raises:
        SettingsError: An argument is no ROS argument, the program has no such parameter, or a params file is invalid.
    """
    unknown = _outside_ros_args(args)
    if unknown:
        near = nearest_name(unknown[0], (*HELP, "--ros-args"))
        raise SettingsError(
            f"Unknown argument '{unknown[0]}'{near}; parameters come after --ros-args: {program.name} "
            "--ros-args -p NAME:=VALUE. --help lists them."
        )
    for flag, value in pairwise(args):
        if flag in REMAP:
            require_valid_name(value)
    node = node_name(program, args)
    for flag, value in pairwise(args):
        if flag == "--params-file":
            _require_parameters(program, f"{flag} {value}")
            found = entries(Path(value))
            if not any(matches(section, node) for section, _ in found):
                only = ", ".join(section for section, _ in found)
                raise SettingsError(
                    f"Params file '{value}' has nothing for node '{node}', only for {only}; "
                    "name its section '/**' or remove the file."
                )
            for section, values in found:
                if matches(section, node):
                    _refuse_empty_lists(values)
        elif flag in PARAM:
            name, is_given, text = value.partition(":=")
            whose, _, name = name.rpartition(":")
            if whose and not matches(whose, node):
                raise SettingsError(
                    f"'{flag} {value}' is for a node '/{whose.lstrip('/')}', and this one is '{node}'; "
                    f"leave out '{whose}:' if you mean this one."
                )
            if is_given and not is_ros_own(name):  # rcl will report what else it may be
                _require_known(program, name, f"{flag} {value}")
            _refuse_empty_lists({name: _yaml(text)})


def node_name(program: Program, args: Sequence[str]) -> str:
    """Return the fully qualified name of a node, as remapped on the command line."""
    namespace, name = "/", program.name
    for word in args:
        rule = re.fullmatch(RENAMES_NODE, word)
        if rule and rule[1] == "ns":
            namespace = rule[2]
        elif rule:
            name = rule[2]
    return f"{namespace.rstrip('/')}/{name}"


def remappings(args: Sequence[str]) -> list[str]:
    """Return the arguments that rename topics and services, so that other nodes of the graph can rename them, too."""
    found: list[str] = []
    for flag, rule in pairwise(args):
        if flag in REMAP and not re.fullmatch(RENAMES_NODE, rule):
            found += [flag, rule]
    return found


def _require_known(program: Program, name: str, given: str) -> None:
    """Refuse a parameter that a command line gives to a node that has none of that name.

    A params file may hold those of other nodes, too.

    Raises:
        SettingsError: The program has no such parameter.
    """
    _require_parameters(program, given)
    known = [f.name for kind in program.parameters for f in fields(kind)]
    if name not in known:
        raise SettingsError(
            f"Unknown parameter '{name}'{nearest_name(name, known)}; --help lists those of '{program.name}', "
            "docs/parameters.md all. One of another node has its place there, or in a params file."
        )


def _require_parameters(program: Program, given: str) -> None:
    if not program.parameters:
        raise SettingsError(
            f"'{given}' has no effect: {program.name} has no parameters; leave it out. {program.name} --help lists its "
            "options."
        )


def _refuse_empty_lists(values: Mapping[str, Any]) -> None:
    """Refuse empty lists: they have no type, and rclpy's traceback does not name the parameter.

    Raises:
        SettingsError: A value is an empty list.
    """
    for name, value in values.items():
        if value == []:
            raise SettingsError(
                f"{name} is an empty list, which ROS 2 cannot pass on; remove it, or give it entries."
            )


def _yaml(text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return None  # rcl will report what is wrong


def _outside_ros_args(args: Sequence[str]) -> list[str]:
    """Return the arguments that are not between ``--ros-args`` and ``--``."""
    outside, inside = [], False
    for word in args:
        if word == "--ros-args":
            inside = True
        elif inside and word == "--":
            inside = False
        elif not inside:
            outside.append(word)
    return outside


def _in_words(error: Exception) -> str:
    """Return what rcl found wrong with the arguments, and what it expected, in plain words."""
    if isinstance(error, UnknownROSArgsError):
        words = " ".join(re.findall(r"'([^']*)'", str(error)))
        return f"Unknown ROS argument '{words}'; expected -p, --params-file, -r or another that `ros2 run` knows."
    text = re.sub(r", at \S+:\d+", "", " ".join(str(error).split()))
    text = text.removeprefix("failed to initialize rcl: ")
    found = re.fullmatch(r"Couldn't parse [^:']*: '(--?\S+) ?(.*)'\. Error: (.*)", text)
    if not found:
        return f"ROS 2 could not start: {text.rstrip('.')}; see --help for valid arguments."
    flag, value, reason = found.groups()
    expected = {
        "-p": "-p NAME:=VALUE, with a VALUE",
        "--param": "--param NAME:=VALUE, with a VALUE",
        "-r": f"-r FROM:=TO, where names have {EXPECTED}",
        "--remap": f"--remap FROM:=TO, where names have {EXPECTED}",
        "--params-file": "a YAML file of ROS 2 parameters, entries of a list all of one type",
        "--log-level": "debug, info, warn, error or fatal",
    }.get(flag, "what `ros2 run` accepts")
    told = "" if "lexeme" in reason or "not set" in reason else f" ({reason.strip()})"
    return f"ROS 2 does not understand '{flag} {value}'{told}; expected {expected}."
