"""The reference: stock pybullet_envs from a world's second episode, from which on all are equal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pybullet_envs_gymnasium.gym_locomotion_envs as envs


def plain_sum(numbers: Iterable[float]) -> float:
    """Add from left to right, as ``sum`` did up to Python 3.11; from 3.12 on it is compensated."""
    total = 0.0
    for number in numbers:
        total += number
    return total


# What the paper's engine computed must not depend on the Python that runs it today.
envs.sum = plain_sum

ENVIRONMENTS: dict[str, Any] = {
    "qd_walker": envs.Walker2DBulletEnv,
    "qd_half_cheetah": envs.HalfCheetahBulletEnv,
    "qd_ant": envs.AntBulletEnv,
    "qd_hopper": envs.HopperBulletEnv,
}


class StockTask:
    """Stock environment of a task, after its first episode, which ignores the floor."""

    def __init__(self, name: str) -> None:
        self._environment = ENVIRONMENTS[name]()
        self.reset(np.random.default_rng(0))

    def reset(self, rng: np.random.Generator) -> np.ndarray:
        self._environment.robot.np_random = rng
        return self._environment.reset()[0]

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool]:
        observation, reward, terminated, _, _ = self._environment.step(action)
        return observation, reward, terminated

    def spin(self, speed: float) -> None:
        client = self._environment._p
        joint = self._environment.robot.ordered_joints[0].jointIndex
        client.resetJointState(self._environment.robot.objects[0], joint, 0.0, speed)

    def contacts(self) -> tuple[bool, ...]:
        return tuple(bool(flag) for flag in self._environment.robot.feet_contact)

    def close(self) -> None:
        self._environment.close()
