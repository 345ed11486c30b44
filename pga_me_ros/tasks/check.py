"""A checker that tells users what is wrong with their own task.

``python -m pga_me_ros.tasks.check my_package.my_module:MyTask`` prints every finding; the exit
status is 1 if there are any.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from pga_me_ros.arguments import ArgumentParser
from pga_me_ros.dependencies import missing_dependency
from pga_me_ros.errors import PgaError
from pga_me_ros.tasks.protocol import NonFiniteActionError
from pga_me_ros.tasks.registry import load_task
from pga_me_ros.tasks.rollout import LARGEST_REWARD, Episode, rollout
from pga_me_ros.tasks.spec import TaskSpec

_METHODS = ("reset", "step", "descriptor", "close")
_STEPS = 60


def check_task(task_class: Any) -> list[str]:
    """Check that a task follows the protocol.

    Starts the simulator twice and runs a few short episodes and a whole one with random and zero actions.

    Args:
        task_class: A class that follows `pga_me_ros.tasks.protocol.Task`.

    Returns:
        One sentence per finding, empty if there are none.
    """
    findings = _check_class(task_class)
    if findings:
        return findings
    task, finding = _attempt("__init__()", task_class)
    if task is None:
        return [finding]
    try:
        findings = _check_first_steps(task)
        if not findings:
            findings = _check_episodes(task, task_class)
        if not findings:
            findings = _check_non_finite_actions(task)
    finally:
        findings += _check_close(task)
    return findings


def _check_class(task_class: Any) -> list[str]:
    if not isinstance(task_class, type):
        return [f"{task_class!r} is not a class; pass the class itself, not an instance"]
    findings = []
    if not isinstance(getattr(task_class, "spec", None), TaskSpec):
        findings.append(
            "class attribute 'spec' is missing or not a TaskSpec; build one and assign it in the class"
        )
    for name in _METHODS:
        if not callable(getattr(task_class, name, None)):
            findings.append(f"method '{name}' is missing; see pga_me_ros.tasks.protocol.Task")
    return findings


def _check_first_steps(task: Any) -> list[str]:
    """Check the types, shapes and ranges of what each method returns."""
    spec: TaskSpec = task.spec
    observation, finding = _attempt("reset(rng)", lambda: task.reset(_rng(0)))
    if finding:
        return [finding]
    findings = _check_array("reset's observation", observation, spec.observation_dim, np.float32)
    result, finding = _attempt(
        "step(action)", lambda: task.step(np.zeros(spec.action_dim, np.float32))
    )
    if finding:
        return [*findings, finding]
    if not isinstance(result, tuple) or len(result) != 3:
        return [*findings, f"step returned {result!r}; expected (observation, reward, terminated)"]
    observation, reward, terminated = result
    findings += _check_array("step's observation", observation, spec.observation_dim, np.float32)
    if type(reward) is not float:
        findings.append(f"step's reward is {_type(reward)}; expected float: convert with float()")
    elif not abs(reward) <= LARGEST_REWARD:
        findings.append(
            f"step's reward is {reward}; expected a finite number within ±{LARGEST_REWARD:.3g} (float32)"
        )
    if type(terminated) is not bool:
        findings.append(
            f"step's terminated is {_type(terminated)}; expected bool: convert with bool()"
        )
    descriptor, finding = _attempt("descriptor()", task.descriptor)
    if finding:
        return [*findings, finding]
    return findings + _check_descriptor(spec, descriptor)


def _check_array(what: str, array: Any, length: int, dtype: type[Any]) -> list[str]:
    expected = f"expected a finite ({length},) {np.dtype(dtype)} array"
    if not isinstance(array, np.ndarray):
        return [f"{what} is {_type(array)}; {expected}"]
    if array.shape != (length,) or array.dtype != dtype:
        return [f"{what} has shape {array.shape} and dtype {array.dtype}; {expected}"]
    if not np.isfinite(array).all():
        return [f"{what} holds NaN or infinity ({array.tolist()}); {expected}"]
    return []


def _check_descriptor(spec: TaskSpec, descriptor: Any) -> list[str]:
    findings = _check_array("descriptor()", descriptor, spec.descriptor_dim, np.float64)
    if findings:
        return findings
    for name, value, low, high in zip(
        spec.descriptor_names, descriptor, spec.descriptor_low, spec.descriptor_high, strict=True
    ):
        if not low <= value <= high:
            findings.append(f"descriptor '{name}' is {value}; the spec says {low} to {high}")
    return findings


def _check_episodes(task: Any, task_class: type[Any]) -> list[str]:
    """Run equal episodes in a used world and in a fresh one; they must be equal bit for bit."""
    runs: dict[str, Episode] = {}
    whole: int = task.spec.max_steps
    plays = (("first", 1, _STEPS), ("other", 2, _STEPS), ("zero", 3, whole), ("again", 1, _STEPS))
    for name, seed, limit in plays:
        episode, finding = _attempt("an episode", partial(_episode, task, seed, limit))
        if episode is None:
            return [finding]
        runs[name] = episode
    findings = _check_descriptor(task.spec, runs["other"].descriptor)
    findings += _check_step_descriptor(task.spec, runs["other"])
    if runs["first"] != runs["again"]:
        findings.append(
            "equal generators and actions gave different episodes after others had run; reset must "
            "restore everything and draw only from its rng"
        )
    fresh, finding = _attempt("a second __init__()", task_class)
    if fresh is None:
        return [*findings, finding]
    try:
        episode, finding = _attempt("an episode of a second task", lambda: _episode(fresh, 1))
        if episode is None:
            findings.append(finding)
        elif runs["first"] != episode:
            findings.append(
                "equal generators and actions gave different episodes in two tasks of one process; "
                "share no state between them and draw no randomness outside reset's rng"
            )
    finally:
        findings += _check_close(fresh)
    return findings


def _check_step_descriptor(spec: TaskSpec, episode: Episode) -> list[str]:
    """Check that the descriptor is the mean of the observation entries named by the spec."""
    columns = [spec.observation_names.index(name) for name in spec.step_descriptor_names]
    if not columns:
        return []
    shown = episode.states[1 + spec.step_descriptor_delay :, columns].astype(np.float64)
    total = episode.length * episode.descriptor
    # If observations are late, none shows the last step; what is left for it must be a possible value.
    low, high = (
        shown.sum(axis=0) + spec.step_descriptor_delay * np.array(bound)
        for bound in (spec.descriptor_low, spec.descriptor_high)
    )
    rounding = 1e-6 * episode.length * (np.abs(low) + np.abs(high) + 1.0)
    if ((low - rounding <= total) & (total <= high + rounding)).all():
        return []
    return [
        f"descriptor() is {episode.descriptor} after {episode.length} steps, but not the mean of the observation "
        f"entries {list(spec.step_descriptor_names)}; correct step_descriptor_names in the spec, or set "
        "step_descriptor_delay to 1 if an observation shows them one step late"
    ]


def _episode(task: Any, seed: int, limit: int = _STEPS) -> Episode:
    spec: TaskSpec = task.spec
    actions = _rng(100 + seed)
    low, high = np.array(spec.action_low), np.array(spec.action_high)
    amplitude = 0.0 if seed == 3 else 1.0

    def controller(_: Any) -> Any:
        return (amplitude * actions.uniform(low, high)).astype(np.float32)

    return rollout(task, controller, _rng(seed), min(spec.max_steps, limit))


def _check_non_finite_actions(task: Any) -> list[str]:
    """Check that a NaN action raises the right error and does not change the episodes after it."""
    before = _episode(task, 1)
    task.reset(_rng(4))
    try:
        task.step(np.full(task.spec.action_dim, np.nan, np.float32))
    except NonFiniteActionError:
        pass
    except (Exception, SystemExit) as error:
        return [f"step with a NaN action raised {_text(error)}; raise NonFiniteActionError"]
    else:
        return [
            "step accepted an action of NaN; raise NonFiniteActionError and leave the world as it is"
        ]
    after, finding = _attempt("an episode after a NaN action", lambda: _episode(task, 1))
    if after is None:
        return [finding]
    return [] if before == after else ["a NaN action changed the episodes after it"]


def _check_close(task: Any) -> list[str]:
    findings = []
    for call in ("close()", "a second close()"):
        _, finding = _attempt(call, task.close)
        if finding:
            findings.append(finding)
    return findings


def _attempt(what: str, call: Callable[[], Any]) -> tuple[Any, str]:
    """Return what a call gives and "", or None and a finding: a user's task may raise anything, or call sys.exit."""
    try:
        return call(), ""
    except (Exception, SystemExit) as error:
        return None, f"{what} raised {_text(error)}"


def _text(error: BaseException) -> str:
    error = missing_dependency(error) or error
    return f"{type(error).__name__}: {error}"


def _type(value: Any) -> str:
    """Return the name of a value's type, with its module unless it is built in: numpy.bool is not bool."""
    kind = type(value)
    return kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"


def _rng(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def main(arguments: list[str]) -> int:
    """Check the tasks named on the command line and print what is wrong with them."""
    parser = ArgumentParser(
        prog="python -m pga_me_ros.tasks.check",
        description="Check that tasks follow the task protocol, and print what is wrong with each.",
    )
    parser.add_argument(
        "tasks",
        nargs="+",
        metavar="TASK",
        help="a built-in name such as qd_hopper, module.path:Class, or gymnasium:ID",
    )
    status = 0
    for name in parser.parse_args(arguments).tasks:
        try:
            findings = check_task(load_task(name))
        except PgaError as error:
            findings = [str(error)]
        for finding in findings or ["follows the task protocol"]:
            print(f"{name}: {finding}")
        status = max(status, bool(findings))
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
