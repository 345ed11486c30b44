"""A trivial task that takes microseconds per step, and settings for runs of a fraction of a second."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import numpy as np

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.protocol import NonFiniteActionError
from pga_me_ros.tasks.spec import TaskSpec

SETTINGS = Settings(
    task="lane_task:Lane",
    seed=3,
    evaluations=160,
    random_init=20,
    batch_size=10,
    n_evo=5,
    cells=16,
    cvt_samples=500,
    controller_hidden=(16,),
    critic_hidden=(32,),
    transition_batch=64,
    n_crit=60,
    n_grad=10,
    pg_learning_rate=0.01,
    critic_learning_rate=0.01,
    greedy_learning_rate=0.01,
    discount=0.0,
    replay_size=3000,
)


class Lane:
    """A point that steers along a lane and leaves it at ±1.5 m; the descriptor is where it ends.

    Only the second action entry decides the reward, which is highest at 0.8 in any state: a gradient finds that at
    once, and the point may steer anywhere.
    """

    spec: ClassVar[TaskSpec] = TaskSpec(
        name="lane",
        observation_names=("aside", "drift"),
        observation_units=("m", "m"),
        action_names=("steer", "throttle"),
        action_units=("0.4 m", ""),
        action_low=(-1.0, -1.0),
        action_high=(1.0, 1.0),
        descriptor_names=("end",),
        descriptor_low=(0.0,),
        descriptor_high=(1.0,),
        max_steps=12,
        control_period=0.1,
        archive_cells=16,
        archive_bins=(16,),
    )

    def __init__(self, *, render: bool = False) -> None:
        self._aside = self._drift = 0.0

    def reset(self, rng: np.random.Generator) -> Float32Array:
        self._aside, self._drift = rng.uniform(-0.1, 0.1, 2).tolist()
        return self._observation()

    def step(self, action: Float32Array) -> tuple[Float32Array, float, bool]:
        if not np.isfinite(action).all():
            raise NonFiniteActionError("lane got an action that is not finite")
        steer, throttle = action.tolist()
        self._aside += 0.4 * steer + 0.1 * self._drift
        reward = 1.0 - (throttle - 0.8) ** 2
        return self._observation(), reward, abs(self._aside) > 1.5

    def descriptor(self) -> Float64Array:
        return np.array([min(max((self._aside + 1.5) / 3.0, 0.0), 1.0)])

    def close(self) -> None:
        pass

    def _observation(self) -> Float32Array:
        return np.array((self._aside, self._drift), np.float32)


class SteeredLane(Lane):
    """A lane without sides; the descriptor is the mean steering, which each observation shows for its step."""

    spec: ClassVar[TaskSpec] = dataclasses.replace(
        Lane.spec,
        name="steered_lane",
        observation_names=("aside", "drift", "steering"),
        observation_units=("m", "m", "0 left to 1 right"),
        descriptor_names=("mean_steering",),
        archive_cells=8,
        archive_bins=(8,),
        step_descriptor_names=("steering",),
    )

    def __init__(self, *, render: bool = False) -> None:
        super().__init__()
        self._steering = [0.5]

    def reset(self, rng: np.random.Generator) -> Float32Array:
        self._steering = [0.5]  # the first observation does not count
        return super().reset(rng)

    def step(self, action: Float32Array) -> tuple[Float32Array, float, bool]:
        self._steering.append((1.0 + float(action[0])) / 2.0)
        return *super().step(action)[:2], False

    def descriptor(self) -> Float64Array:
        return np.array([np.mean(self._steering[1:] or self._steering)])

    def _observation(self) -> Float32Array:
        return np.array((self._aside, self._drift, self._steering[-1]), np.float32)


def settings_of(algorithm: str, **changes: Any) -> Settings:
    """Return `SETTINGS` for another algorithm, without those that it does not use, and with changes."""
    return Settings.from_stored({**SETTINGS.given, "algorithm": algorithm}).replace(**changes)


def grown(
    settings: Settings = SETTINGS, generations: int | None = None, task_class: type[Lane] = Lane
) -> Search:
    """Return a search after its whole budget, or after some generations."""
    search, task = Search(task_class.spec, settings), task_class()
    for _ in range(settings.generations if generations is None else generations):
        search.run_generation(task)
    return search


def learner_bits(state: dict[str, Any]) -> bytes:
    """Return everything that a learner's next step depends on, as bytes."""
    return b"".join(state[name].tobytes() for name in sorted(state))
