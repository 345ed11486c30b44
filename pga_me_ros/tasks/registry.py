"""Names of tasks: the built-in ones and ``module.path:Class`` for a user's own."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import json
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from pga_me_ros.dependencies import missing
from pga_me_ros.errors import TaskError, nearest_name
from pga_me_ros.tasks.damage import DamageError, read_damage
from pga_me_ros.tasks.gym.name import PREFIX as GYMNASIUM_PREFIX
from pga_me_ros.tasks.gym.task import gymnasium_class
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.randomization import RandomizationError, read_ranges
from pga_me_ros.tasks.spec import TaskSpec

BUILT_IN = {
    "qd_walker": "pga_me_ros.tasks.bullet.locomotion:QDWalker",
    "qd_half_cheetah": "pga_me_ros.tasks.bullet.locomotion:QDHalfCheetah",
    "qd_ant": "pga_me_ros.tasks.bullet.locomotion:QDAnt",
    "qd_hopper": "pga_me_ros.tasks.bullet.locomotion:QDHopper",
}


def load_task(name: str) -> type[Task]:
    """Return the class of a task, without starting or importing a simulator.

    Args:
        name: A key of `BUILT_IN`, ``gymnasium:ID`` (`pga_me_ros.tasks.gym.name`), or ``module.path:Class`` for a class
            on the Python path.

    Raises:
        MissingDependencyError: Its module needs a package that is not installed.
        TaskError: The name is unknown, or its module or class cannot be loaded.
    """
    if not isinstance(name, str):
        raise TaskError(f"a task is named by a string, not {type(name).__name__}")
    if name.startswith(GYMNASIUM_PREFIX):
        return gymnasium_class(name)
    path = BUILT_IN.get(name, name)
    if ":" not in path:
        raise TaskError(
            f"unknown task '{name}'{nearest_name(name, BUILT_IN)}; built-in tasks are "
            f"{', '.join(BUILT_IN)}, any other is given as "
            "'module.path:Class' or 'gymnasium:ID'"
        )
    task_class = _load_class(name, *path.split(":", 1))
    if not isinstance(getattr(task_class, "spec", None), TaskSpec):
        raise TaskError(f"task '{name}' has no class attribute 'spec' that is a TaskSpec; add one")
    return task_class


def task_spec(name: str) -> TaskSpec:
    """Return the spec of a task, see `load_task`."""
    return load_task(name).spec


def make_task(name: str, randomization: str = "", damage: str = "") -> Task:
    """Return a task that is ready for episodes; its simulator is started.

    Args:
        name: As in `load_task`.
        randomization: What is another in each episode (`tasks.randomization`); empty for nothing.
        damage: What is wrong with robot or world in all episodes (`tasks.damage`); empty for nothing.

    Raises:
        DamageError: As in `damage_option`.
        RandomizationError: As in `randomization_option`.
        TaskError: As in `load_task`, or its class raises when it is called.
    """
    task_class = load_task(name)
    options = randomization_option(name, randomization) | damage_option(name, damage)
    try:
        return task_class(**options)
    except ModuleNotFoundError as error:
        raise missing(error.name or str(error), f"task '{name}'") from error
    except DamageError:
        raise
    except (Exception, SystemExit) as error:  # a user's class may raise anything
        raise TaskError(
            f"task '{name}' does not start ({type(error).__name__}: {error}); its class is called "
            "without arguments and must return a task that is ready for reset()"
        ) from error


def simulation_versions(name: str) -> str:
    """Return the versions that a task's results depend on, in words: evaluators of a run must agree on them.

    The last one tells specs apart: a checkout of another revision may have the same task with other limits.

    Args:
        name: As in `load_task`, which it raises like.
    """
    libraries = ["numpy", "pybullet"]
    if name.startswith(GYMNASIUM_PREFIX):
        libraries += ["gymnasium", "mujoco"]
    # From 3.12 on, sum() of floats rounds differently, and a user's task may use it.
    found = [f"python {sys.version_info.major}.{sys.version_info.minor}"]
    for library in libraries:
        try:
            found.append(f"{library} {version(library)}")
        except PackageNotFoundError:
            found.append(f"no {library}")
    spec = json.dumps(task_spec(name).to_json(), sort_keys=True)
    found.append(f"task spec {hashlib.sha256(spec.encode()).hexdigest()[:8]}")
    return ", ".join(found)


def randomization_option(name: str, randomization: str) -> dict[str, Any]:
    """Return the argument that makes a task another one in each episode, none where nothing is randomized.

    Starts no simulator.

    Args:
        name: As in `load_task`.
        randomization: As in `make_task`.

    Raises:
        RandomizationError: The text makes no sense, or the task's class takes no such argument.
        TaskError: As in `load_task`.
    """
    if not read_ranges(randomization):
        return {}
    if not _takes(load_task(name), "randomization"):
        raise RandomizationError(
            f"task '{name}' cannot be randomized: its class takes no argument `randomization`; leave the setting out, "
            "or add the argument (docs/tasks.md)"
        )
    return {"randomization": randomization}


def damage_option(name: str, damage: str) -> dict[str, Any]:
    """Return the argument that damages a task's robot or world, none where nothing is damaged.

    Starts no simulator. A class may have a class method ``check_damage(text)`` that raises `DamageError` for what its
    robot cannot have; otherwise only the words are checked here.

    Args:
        name: As in `load_task`.
        damage: As in `make_task`.

    Raises:
        DamageError: The text makes no sense, the robot has no such part, or the task's class takes no such argument.
        TaskError: As in `load_task`.
    """
    task_class = load_task(name)
    if not damage.strip():
        return {}
    if not _takes(task_class, "damage"):
        read_damage(damage)
        raise DamageError(
            f"task '{name}' cannot be damaged: its class takes no argument `damage`; leave it out, or add the argument "
            "(docs/tasks.md)"
        )
    getattr(task_class, "check_damage", read_damage)(damage)
    return {"damage": damage}


def _takes(task_class: type[Task], argument: str) -> bool:
    """Whether a class can be called with an argument of this name."""
    parameters = inspect.signature(task_class).parameters.values()
    return any(p.name == argument or p.kind is p.VAR_KEYWORD for p in parameters)


def _load_class(name: str, module_path: str, class_name: str) -> type[Any]:
    try:
        module = importlib.import_module(module_path)
    except (Exception, SystemExit) as error:  # a user's module may raise anything while it loads
        lacking = isinstance(error, ModuleNotFoundError) and error.name
        if lacking and not f"{module_path}.".startswith(f"{lacking}."):
            raise missing(lacking, f"task '{name}'") from error
        raise TaskError(
            f"task '{name}': module '{module_path}' does not load "
            f"({type(error).__name__}: {error}); check the spelling and that its package is on "
            "the Python path"
        ) from error
    task_class = getattr(module, class_name, None)
    if not isinstance(task_class, type):
        classes = [key for key, value in vars(module).items() if isinstance(value, type)]
        raise TaskError(
            f"task '{name}': module '{module_path}' has no class '{class_name}'"
            f"{nearest_name(class_name, classes)}; expected 'module.path:Class'"
        )
    return task_class
