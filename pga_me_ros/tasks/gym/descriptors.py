"""Descriptors of Gymnasium tasks: what the repertoire's behaviors shall differ in.

A descriptor of your own is named ``module:name`` and is one of two things:

* a class with the members of `EpisodeDescriptor`, for what has to be watched during the episode;
* a function ``f(observations, actions)`` of the whole episode, with attributes ``low`` and ``high`` (one number per
  dimension) and, if you like, ``names``. It gets float64 arrays (T + 1, observation_dim) and (T, action_dim) and
  returns one number per dimension.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.errors import TaskError, nearest_name

FEET = {
    "Walker2d": {"right": "foot_geom", "left": "foot_left_geom"},
    "HalfCheetah": {"front": "ffoot", "back": "bfoot"},
    "Hopper": {"foot": "foot_geom"},
    "Ant": {
        "front_left": "left_ankle_geom",
        "front_right": "right_ankle_geom",
        "back_left": "third_ankle_geom",
        "back_right": "fourth_ankle_geom",
    },
}
"""Geoms of the feet by name of the environment, without version."""

_FREE, _SLIDE = 0, 2
"""MuJoCo's types of a root joint."""


class EpisodeDescriptor(Protocol):
    """A descriptor that watches an episode. Its class is called with the environment."""

    @property
    def names(self) -> Sequence[str]:
        """One name per dimension."""
        ...

    @property
    def low(self) -> Sequence[float]:
        """Lower bounds."""
        ...

    @property
    def high(self) -> Sequence[float]:
        """Upper bounds."""
        ...

    def begin(self, observation: Float64Array) -> None:
        """Begin an episode. The arrays given here and to `step` may be kept: nobody changes them."""
        ...

    def step(self, observation: Float64Array, action: Float64Array) -> None:
        """Note a step: the action and the observation after it."""
        ...

    def value(self) -> Sequence[float] | Float64Array:
        """Return one number per dimension for the episode so far."""
        ...


class FeetContact:
    """For each foot, the share of steps after which it touched the floor: the paper's descriptor, QDax's ``*_uni``."""

    def __init__(self, env: Any) -> None:
        """Find the feet.

        Raises:
            TaskError: The environment is none of those in `FEET`.
        """
        self._data: Any = getattr(env.unwrapped, "data", None)
        feet = FEET.get(env.spec.name)  # without namespace and version
        if feet is None or self._data is None:
            raise TaskError(
                f"no feet are known of the environment '{env.spec.id}'; descriptor=feet is for {', '.join(FEET)}. "
                "Give descriptor=final_position or descriptor=module:name"
            )
        model = env.unwrapped.model
        self._floor = model.geom("floor").id
        self._feet = [model.geom(name).id for name in feet.values()]
        self.names = [f"{name}_contact" for name in feet]
        self.low, self.high = [0.0] * len(feet), [1.0] * len(feet)

    def begin(self, observation: Float64Array) -> None:
        """Begin an episode."""
        self._steps, self._touched = 0, [0] * len(self._feet)

    def step(self, observation: Float64Array, action: Float64Array) -> None:
        """Note which feet touch the floor now."""
        contact = self._data.contact
        touching = {
            b if a == self._floor else a
            for a, b in zip(contact.geom1.tolist(), contact.geom2.tolist(), strict=True)
            if self._floor in (a, b)
        }
        self._steps += 1
        for i, foot in enumerate(self._feet):
            self._touched[i] += foot in touching

    def value(self) -> list[float]:
        """Return the shares."""
        return [touched / max(self._steps, 1) for touched in self._touched]


class FinalPosition:
    """Where the robot is at the end, m from the world's origin, as in QDax's ``*_omni``; one dimension if planar."""

    def __init__(self, env: Any) -> None:
        """Find the robot's root joint.

        Raises:
            TaskError: The environment is not one of MuJoCo's, or its robot stands still.
        """
        model: Any = getattr(env.unwrapped, "model", None)
        kind = int(model.jnt_type[0]) if hasattr(model, "jnt_type") and model.njnt else None
        if kind not in (_FREE, _SLIDE):
            raise TaskError(
                f"'{env.spec.id}' has no robot that moves about in MuJoCo; give descriptor=module:name"
            )
        self._data = env.unwrapped.data
        self.names = ["final_x", "final_y"] if kind == _FREE else ["final_x"]
        self.low, self.high = [-30.0] * len(self.names), [30.0] * len(self.names)

    def begin(self, observation: Float64Array) -> None:
        """Begin an episode."""

    def step(self, observation: Float64Array, action: Float64Array) -> None:
        """Note nothing: the simulation knows."""

    def value(self) -> list[float]:
        """Return the coordinates."""
        values: list[float] = self._data.qpos[: len(self.names)].tolist()
        return values


class OfEpisode:
    """The value of a user's function of observations and actions."""

    def __init__(self, function: Any) -> None:
        """Take the function, which has `low` and `high`."""
        self._function = function
        self.low, self.high = list(function.low), list(function.high)
        self.names = list(
            getattr(function, "names", [f"descriptor_{i}" for i in range(len(self.low))])
        )

    def begin(self, observation: Float64Array) -> None:
        """Begin an episode."""
        self._observations: list[Float64Array] = [observation]
        self._actions: list[Float64Array] = []

    def step(self, observation: Float64Array, action: Float64Array) -> None:
        """Keep a step."""
        self._observations.append(observation)
        self._actions.append(action)

    def value(self) -> Any:
        """Return what the function gives."""
        width = (len(self._actions), -1) if self._actions else (0, 0)
        return self._function(np.array(self._observations), np.reshape(self._actions, width))


BUILT_IN: dict[str, Callable[[Any], EpisodeDescriptor]] = {
    "feet": FeetContact,
    "final_position": FinalPosition,
}


def make_descriptor(task: str, name: str, env: Any) -> EpisodeDescriptor:
    """Return the descriptor of a task.

    Args:
        task: The task's name, for messages.
        name: A key of `BUILT_IN`, or ``module:name``; empty for ``feet``.
        env: The environment.

    Raises:
        TaskError: There is no such descriptor, or it doesn't fit.
    """
    name = name or "feet"
    if name in BUILT_IN:
        return BUILT_IN[name](env)
    if ":" not in name:
        raise TaskError(
            f"task '{task}': unknown descriptor '{name}'{nearest_name(name, BUILT_IN)}; expected "
            f"{', '.join(BUILT_IN)}, or your own as module:name"
        )
    module, _, attribute = name.partition(":")
    try:
        found = getattr(importlib.import_module(module), attribute)
    except (Exception, SystemExit) as error:  # a user's module may raise anything while it loads
        raise TaskError(
            f"task '{task}': descriptor '{name}' does not load ({type(error).__name__}: {error}); check the spelling "
            "and that its module is on the Python path"
        ) from error
    if isinstance(found, type):
        return _own_class(task, name, found, env)
    if not callable(found) or not hasattr(found, "low") or not hasattr(found, "high"):
        raise TaskError(
            f"task '{task}': descriptor '{name}' is no function with attributes 'low' and 'high'; set them after its "
            "definition, one number per dimension, as in `f.low = [0.0, 0.0]`"
        )
    return OfEpisode(found)


def _own_class(task: str, name: str, found: type[Any], env: Any) -> EpisodeDescriptor:
    lacking = [part for part in ("begin", "step", "value") if not hasattr(found, part)]
    if lacking:
        raise TaskError(
            f"task '{task}': descriptor class '{name}' lacks {', '.join(lacking)}; see "
            "pga_me_ros.tasks.gym.descriptors.EpisodeDescriptor"
        )
    try:
        made: EpisodeDescriptor = found(env)
        len(made.names), len(made.low), len(made.high)
    except (Exception, SystemExit) as error:
        raise TaskError(
            f"task '{task}': descriptor class '{name}' does not start ({type(error).__name__}: {error}); it is called "
            "with the environment and has names, low and high"
        ) from error
    return made


def checked_value(name: str, value: Any, dimension: int) -> Float64Array:
    """Return a descriptor's value as an array.

    Raises:
        TaskError: It has another length than the bounds, or isn't finite.
    """
    try:
        out = np.array(value, np.float64)
    except (TypeError, ValueError):
        out = np.array(math.nan)
    if out.shape != (dimension,) or not np.isfinite(out).all():
        raise TaskError(
            f"descriptor '{name}' gave {value!r}; expected {dimension} finite numbers, as 'low' and 'high' have"
        )
    return out
