"""Bad values for every parameter of every node, given to the real nodes in this process.

``python test/ros/parameter_fuzz.py`` tries all values for all parameters, which takes minutes; ``--short`` one each.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr
from dataclasses import Field, dataclass, fields
from io import StringIO
from itertools import count
from pathlib import Path
from typing import Any

from rclpy.executors import ExternalShutdownException

from pga_me_ros.core.runs.run_directory import default_run_dir, open_run
from pga_me_ros.nodes import (
    adapter,
    archive_manager,
    behavior_player,
    controller,
    critic_trainer,
    evaluator,
    orchestrator,
    record,
    variation,
)
from pga_me_ros.orchestration.control import Control
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.process import run_node
from pga_me_ros.tasks.registry import task_spec

TOO_LONG = "x" * 300
"""Name that no file system allows, so that looking it up fails."""

NOBODY = 65534
"""User id without permissions."""


def _orchestrator() -> Control:
    """Start like an orchestrator, up to its first child."""
    control = Control()
    try:
        path = Path(control.options.run_dir or default_run_dir(control.settings))
        open_run(path, task_spec(control.settings.task), control.settings).lock.release()
    except BaseException:
        control.destroy_node()
        raise
    return control


CHILD = {"run_id": "x"}
NODES: dict[str, tuple[Program, Callable[[], Any], dict[str, Any]]] = {
    "orchestrator": (orchestrator.PROGRAM, _orchestrator, {"cvt_samples": 1024}),
    "behavior_player": (behavior_player.PROGRAM, behavior_player.BehaviorPlayer, {}),
    "controller": (controller.PROGRAM, controller.JointController, {}),
    "adapter": (adapter.PROGRAM, adapter.Adapter, {}),
    "archive_manager": (archive_manager.PROGRAM, archive_manager.ArchiveManager, {}),
    "record": (record.PROGRAM, record.Recorder, {}),
    "evaluator": (evaluator.PROGRAM, evaluator.Evaluator, {}),
    "variation": (variation.PROGRAM, variation.Variation, CHILD),
    "critic_trainer": (critic_trainer.PROGRAM, critic_trainer.CriticTrainerNode, CHILD),
}


@dataclass(frozen=True)
class Case:
    """A parameter and a value, as on a command line, that must be refused."""

    node: str
    name: str
    value: str

    def __str__(self) -> str:
        return f"{self.node}-{self.name}-{self.value[:20]}"


def bad_values(f: Field[Any]) -> Iterator[str]:
    """Yield invalid values of a parameter, the most informative ones first."""
    meta, default = f.metadata, f.default
    yield "[]"
    if meta["path"]:
        yield f"/tmp/{TOO_LONG}"
        yield f"{TOO_LONG}/below"
    if isinstance(default, tuple):
        yield "[a]"
        yield "5"
        yield "[true]"
        if meta["low"] is not None:
            yield f"[{int(meta['low']) - 1}]"
            yield f"[{int(meta['high']) + 1}]"
    elif isinstance(default, (bool, str)):
        yield "[true]"
        yield "5"
        yield "1.5"
        if meta["choices"]:
            yield "nothing_of_these"
    else:
        yield "nan"
        yield "abc"
        yield "[1]"
        yield "true"
        if meta["low"] is not None:
            yield str(meta["low"] - 1)
            if math.isfinite(meta["high"]):  # infinite: any number above the lowest is valid
                yield str(meta["high"] + 1)
            yield "1e400"
            yield "-.inf"


def cases(*, short: bool = False) -> Iterator[Case]:
    """Yield all cases, or one per parameter with varying kinds of values, and shared parameters on one node only."""
    seen: set[type] = set()
    turn = count()
    for node, (program, _, _) in NODES.items():
        for kind in program.parameters:
            if kind in seen and short:
                continue
            seen.add(kind)
            for f in fields(kind):
                values = list(bad_values(f))
                for value in [values[next(turn) % len(values)]] if short else values:
                    yield Case(node, f.name, value)


EMPTY_LISTS = (
    Case("orchestrator", "controller_hidden", "[]"),
    Case("behavior_player", "descriptor", "[]"),
)


def outcome(node: str, **parameters: str) -> tuple[int, str]:
    """Start a node with parameters and end it at once; return its exit code and error output."""
    program, make, own = NODES[node]

    def once() -> Any:
        make().destroy_node()
        raise ExternalShutdownException

    arguments = ["--ros-args"]
    for name, value in {**own, **parameters}.items():
        arguments += ["-p", f"{name}:={value}"]
    said = StringIO()
    with redirect_stderr(said):
        code = run_node(program, once, arguments)
    return code, said.getvalue()


def fault(case: Case) -> str:
    """Return what is wrong with the refusal of a case, "" if nothing is."""
    code, said = outcome(case.node, **{case.name: case.value})
    if code == 2 and said.startswith("error: ") and said.count("\n") == 1 and case.name in said:
        return ""
    return f"{case}: exit code {code}, {said[-500:]}"


@contextmanager
def closed_folder() -> Iterator[Path]:
    """Yield a folder below one that this process may not enter, even as root."""
    root = os.geteuid() == 0
    with tempfile.TemporaryDirectory() as outside:
        inside = Path(outside) / "inside"
        inside.mkdir()
        os.chmod(outside, 0)
        try:
            if root:
                os.seteuid(NOBODY)
            yield inside
        finally:
            if root:
                os.seteuid(0)
            os.chmod(outside, 0o700)


def path_cases(path: Path) -> Iterator[Case]:
    """Yield cases with a path for every parameter that takes one."""
    for node, (program, _, _) in NODES.items():
        for f in (f for kind in program.parameters for f in fields(kind) if f.metadata["path"]):
            yield Case(node, f.name, str(path))


def main() -> int:
    """Try everything; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="one value per parameter")
    short = parser.parse_args().short
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o777)
        os.environ["ROS_LOG_DIR"] = folder
        os.chdir(folder)
        tried = [*cases(short=short), *EMPTY_LISTS]
        faults = [words for case in tried if (words := fault(case))]
        with closed_folder() as closed:
            tried += (closed_cases := list(path_cases(closed)))
            faults += [words for case in closed_cases if (words := fault(case))]
    for words in faults:
        print(f"WRONG: {words}")
    print(f"{len(tried)} values of parameters, {len(faults)} not refused in one line")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
