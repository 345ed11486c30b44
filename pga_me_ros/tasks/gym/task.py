"""A Gymnasium environment as a task: ``-p task:=gymnasium:Walker2d-v5``, see `pga_me_ros.tasks.gym.name`."""

from __future__ import annotations

import importlib
import math
from functools import cache
from typing import Any, ClassVar

import numpy as np

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.dependencies import imported, missing_dependency
from pga_me_ros.errors import TaskError, nearest_name
from pga_me_ros.tasks.body import MujocoBody
from pga_me_ros.tasks.gym.descriptors import checked_value, make_descriptor
from pga_me_ros.tasks.gym.entries import action_names, observation_entries
from pga_me_ros.tasks.gym.name import Options, read_name
from pga_me_ros.tasks.protocol import NonFiniteActionError
from pga_me_ros.tasks.spec import TaskSpec

_SEEDS = 2**31
_PERIOD = 0.05
"""Control period of an environment that names none, s."""


class GymnasiumTask:
    """A task whose episodes an environment plays. `gymnasium_class` makes a class per environment.

    Actions are mapped linearly from -1 to 1 onto the bounds of the environment's action space. Truncation is not a
    fall: the time limit is the task's `max_steps`, and the environment's own time limit is taken off.

    Args:
        render: Whether to open the environment's window.

    Raises:
        TaskError: The environment does not start.
    """

    spec: ClassVar[TaskSpec]
    name: ClassVar[str]
    options: ClassVar[Options]

    def __init__(self, *, render: bool = False) -> None:
        """Make the environment."""
        self._env: Any = make_env(self.name, self.options, render=render)
        self._descriptor = make_descriptor(self.name, self.options.descriptor, self._env)
        space = self._env.action_space
        self._low, self._range = (
            space.low.astype(np.float64),
            space.high.astype(np.float64) - space.low.astype(np.float64),
        )
        self._bounds = np.array(self.spec.descriptor_low), np.array(self.spec.descriptor_high)
        self._steps = 0
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> Float32Array:
        """Begin an episode with a seed drawn from a generator.

        Returns:
            (observation_dim,) float32, the first observation.
        """
        observation, _ = self._env.reset(seed=int(rng.integers(_SEEDS)))
        self._steps = 0
        self._descriptor.begin(np.array(observation, np.float64))
        return np.array(observation, np.float32)

    def step(self, action: Float32Array) -> tuple[Float32Array, float, bool]:
        """Apply an action for one control period.

        Args:
            action: (action_dim,) float32, -1 to 1 within the bounds of the environment's actions.

        Returns:
            Observation, reward, and whether the environment terminated the episode (the robot fell).

        Raises:
            NonFiniteActionError: The action holds NaN or infinity; nothing was simulated.
            TaskError: The environment truncated the episode before the task's `max_steps`.
        """
        if not np.isfinite(action).all():
            raise NonFiniteActionError(f"{self.name} got an action that is not finite: {action}")
        share = (np.clip(np.asarray(action, np.float64), -1.0, 1.0) + 1.0) / 2.0
        applied = self._low + share * self._range
        result = self._env.step(applied.astype(self._env.action_space.dtype))
        observation, reward, terminated, truncated, _ = result
        self._steps += 1
        if truncated and not terminated and self._steps < self.spec.max_steps:
            raise TaskError(
                f"task '{self.name}' truncated an episode after {self._steps} steps, though its time limit is "
                f"{self.spec.max_steps}; give max_steps={self._steps} in its name, or take off the wrapper that does so"
            )
        self._descriptor.step(np.array(observation, np.float64), applied)
        return np.array(observation, np.float32), float(reward), bool(terminated)

    def descriptor(self) -> Float64Array:
        """Return the descriptor of the episode so far, clipped to its bounds.

        Raises:
            TaskError: A user's descriptor has the wrong length, or is not finite.
        """
        value = checked_value(
            self.options.descriptor or "feet", self._descriptor.value(), self.spec.descriptor_dim
        )
        return np.clip(value, *self._bounds)

    @property
    def body(self) -> MujocoBody:
        """The robot in its simulation, for display.

        Raises:
            TaskError: The environment is not one of MuJoCo's.
        """
        unwrapped = self._env.unwrapped
        model, data = getattr(unwrapped, "model", None), getattr(unwrapped, "data", None)
        if not hasattr(model, "body_parentid") or not hasattr(data, "qpos"):
            raise TaskError(
                f"task '{self.name}' cannot be shown: its environment is none of MuJoCo's, which tell where the "
                "parts of the robot are"
            )
        return MujocoBody(model, data, name=self._env.spec.name)

    def close(self) -> None:
        """Close the environment; a second call does nothing."""
        if self._env is not None:
            self._env.close()
            self._env = None


@cache
def gymnasium_class(name: str) -> type[GymnasiumTask]:
    """Return the task class of a name; the environment is made once, to read its spaces.

    Raises:
        MissingDependencyError: Gymnasium is not installed.
        TaskError: The environment does not exist, does not start or does not fit.
    """
    options = read_name(name)
    env = make_env(name, options)
    try:
        spec = _spec(name, options, env)
    finally:
        env.close()
    return type("GymnasiumTask", (GymnasiumTask,), {"name": name, "options": options, "spec": spec})


def make_env(name: str, options: Options, *, render: bool = False) -> Any:
    """Return an environment without its own time limit.

    Args:
        name: The task's name, for messages.
        options: What the name says.
        render: Whether it opens a window.

    Raises:
        TaskError: As in `gymnasium_class`.
    """
    gymnasium = imported("gymnasium", purpose=f"task '{name}'")
    if ":" not in options.env_id and options.env_id not in gymnasium.registry:
        raise TaskError(
            f"task '{name}': Gymnasium knows no environment '{options.env_id}'"
            f"{nearest_name(options.env_id, gymnasium.registry)}; import its package with 'module:ID' if another "
            "package registers it"
        )
    mode = {"render_mode": "human"} if render else {}
    try:
        env = gymnasium.make(
            options.env_id,
            max_episode_steps=-1,
            disable_env_checker=True,
            **mode,
            **options.kwargs,
        )
        for wrapper in options.wrappers:
            module, _, attribute = wrapper.partition(":")
            env = getattr(importlib.import_module(module), attribute)(env)
    except (Exception, SystemExit) as error:  # an environment or wrapper may raise anything
        # Gymnasium wraps what it cannot import.
        if lacking := missing_dependency(error.__cause__ or error):
            raise lacking from error
        raise TaskError(
            f"task '{name}' does not start ({type(error).__name__}: {error}); check its arguments, and that its "
            "simulator is installed (for MuJoCo: pip install 'gymnasium[mujoco]')"
        ) from error
    return env


def _spec(name: str, options: Options, env: Any) -> TaskSpec:
    from gymnasium.spaces import Box

    for what, space in (("observation", env.observation_space), ("action", env.action_space)):
        if not isinstance(space, Box) or len(space.shape) != 1 or space.shape[0] < 1:
            raise TaskError(
                f"task '{name}' has the {what} space {space}; expected a Box with one axis: wrap the environment, or "
                "choose one for continuous control"
            )
    low, high = env.action_space.low, env.action_space.high
    if not (np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()):
        raise TaskError(
            f"task '{name}' has actions from {low.tolist()} to {high.tolist()}; expected finite bounds with low < "
            "high: wrap the environment (wrapper=module:Class)"
        )
    described = make_descriptor(name, options.descriptor, env)
    lows, highs = options.low or described.low, options.high or described.high
    names = tuple(str(text) for text in described.names)
    if not len(names) == len(lows) == len(highs):
        raise TaskError(
            f"task '{name}': the descriptor has {len(names)} names, {len(lows)} lower and {len(highs)} upper bounds; "
            "expected one of each per dimension"
        )
    entries = observation_entries(env, env.observation_space.shape[0])
    actions = action_names(env, len(low))
    period = float(getattr(env.unwrapped, "dt", _PERIOD))
    return TaskSpec(
        name=name,
        observation_names=tuple(entry for entry, _ in entries),
        observation_units=tuple(unit for _, unit in entries),
        action_names=tuple(actions),
        action_units=("share of the range",) * len(actions),
        action_low=(-1.0,) * len(actions),
        action_high=(1.0,) * len(actions),
        descriptor_names=names,
        descriptor_low=tuple(float(bound) for bound in lows),
        descriptor_high=tuple(float(bound) for bound in highs),
        max_steps=options.max_steps or _time_limit(name, env),
        control_period=period,
        archive_cells=options.cells,
        archive_bins=(max(2, math.floor(options.cells ** (1.0 / len(names)))),) * len(names),
    )


def _time_limit(name: str, env: Any) -> int:
    """Return the time limit that the environment is registered with."""
    import gymnasium

    limit = gymnasium.spec(env.spec.id).max_episode_steps
    if limit is None:
        raise TaskError(
            f"task '{name}' has no time limit; give one in its name, as in '{name}?max_steps=1000'"
        )
    return int(limit)
