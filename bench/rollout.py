"""Simulation steps of our tasks compared with stock pybullet_envs, the bare physics engine and MuJoCo's robots.

Run: `.venv/bin/python bench/rollout.py [--rounds 9]`; the last line is JSON. Every figure is a
ratio of things measured in turn (A B C A B C ...) in this process, the median over rounds. Episodes
are the same on all sides, bit for bit: same initial poses, same actions. MuJoCo's robots (`gymnasium:...`) are
others of the same kind; `mujoco_steps` is their steps/s relative to those of PyBullet's, both as tasks of ours.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pybullet
import pybullet_envs_gymnasium.gym_locomotion_envs as stock_envs
import torch
from _measure import tabulated
from torch import nn

from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.tasks.registry import load_task
from pga_me_ros.tasks.rollout import rollout

STOCK = {
    "qd_walker": stock_envs.Walker2DBulletEnv,
    "qd_half_cheetah": stock_envs.HalfCheetahBulletEnv,
    "qd_ant": stock_envs.AntBulletEnv,
    "qd_hopper": stock_envs.HopperBulletEnv,
}

MUJOCO = {
    "qd_walker": "gymnasium:Walker2d-v5",
    "qd_half_cheetah": "gymnasium:HalfCheetah-v5",
    "qd_ant": "gymnasium:Ant-v5",
    "qd_hopper": "gymnasium:Hopper-v5",
}
"""The robot of the same kind in MuJoCo."""


@dataclass(frozen=True)
class Script:
    """An episode to replay: seed of the initial pose and one float32 action per step."""

    seed: int
    actions: list[np.ndarray]


def generator(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


def rhythmic_episodes(task: Any, count: int = 8, limit: int = 100) -> list[Script]:
    """Return the longest of many episodes under sinusoids of random amplitude, phase and offset."""
    rng, dimension = generator(0), task.spec.action_dim
    scripts = []
    for seed in range(4 * count):
        phase, offset = rng.uniform(0, 6.3, dimension), rng.uniform(-0.3, 0.3, dimension)
        rate, size = rng.uniform(0.1, 0.4), rng.uniform(0.1, 0.6)
        task.reset(generator(seed))
        script = Script(seed, [])
        for t in range(limit):
            wave = offset + size * np.sin(rate * t + phase)
            script.actions.append(np.clip(wave, -1, 1).astype(np.float32))
            if task.step(script.actions[-1])[2]:
                break
        scripts.append(script)
    return sorted(scripts, key=lambda script: -len(script.actions))[:count]


def steps_of(scripts: list[Script]) -> int:
    """Return the steps of all episodes."""
    return sum(len(script.actions) for script in scripts)


def stock_reset(environment: Any, seed: int) -> np.ndarray:
    environment.robot.np_random = generator(seed)
    return environment.reset()[0]


def time_stock(environment: Any, script: Script) -> float:
    stock_reset(environment, script.seed)
    start = time.perf_counter()
    for action in script.actions:
        environment.step(action)
    return time.perf_counter() - start


def time_ours(task: Any, script: Script) -> float:
    task.reset(generator(script.seed))
    start = time.perf_counter()
    for action in script.actions:
        task.step(action)
    return time.perf_counter() - start


def time_physics(task: Any, script: Script) -> float:
    """Return the time in stepSimulation only, for the same motion."""
    total, world = 0.0, task._world
    task.reset(generator(script.seed))
    for forces in [task._torques(action.tolist()) for action in script.actions]:
        pybullet.setJointMotorControlArray(
            world.robot,
            world.joints,
            pybullet.TORQUE_CONTROL,
            forces=forces,
            physicsClientId=world.client,
        )
        start = time.perf_counter()
        pybullet.stepSimulation(world.client)
        total += time.perf_counter() - start
    return total


def torch_policy(controller: MlpController) -> nn.Sequential:
    layers: list[nn.Module] = []
    for matrix in controller._matrices:
        linear = nn.Linear(len(matrix) - 1, matrix.shape[1])
        with torch.no_grad():
            linear.weight.copy_(torch.from_numpy(matrix[:-1].T))
            linear.bias.copy_(torch.from_numpy(matrix[-1]))
        layers += [linear, nn.ReLU()]
    return nn.Sequential(*layers[:-1], nn.Tanh())


def plain_episode(environment: Any, policy: nn.Sequential, seed: int, limit: int) -> int:
    """Run an episode in a plain loop: torch policy, one row stacked per step."""
    state = stock_reset(environment, seed)
    states, actions, rewards = state[None], None, []
    for _ in range(limit):
        with torch.no_grad():
            action = policy(torch.from_numpy(state)[None])[0].numpy()
        state, reward, fell, _, _ = environment.step(action)
        states = np.vstack((states, state))
        actions = action[None] if actions is None else np.vstack((actions, action))
        rewards.append(reward)
        if fell:
            break
    return len(rewards)


def time_call(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def measure_task(name: str, rounds: int) -> dict[str, list[float]]:
    """Return the ratios of each round."""
    task, environment = load_task(name)(), STOCK[name]()
    stock_reset(environment, 0)
    scripts = rhythmic_episodes(task)
    other = load_task(MUJOCO[name])()
    others = rhythmic_episodes(other)
    longer = steps_of(others) / steps_of(scripts)
    shape = MlpShape((task.spec.observation_dim, 128, 128, task.spec.action_dim))
    controllers = [MlpController(shape, random_parameters(shape, generator(i))) for i in range(8)]
    policies = [torch_policy(controller) for controller in controllers]
    ratios: dict[str, list[float]] = {
        "step_vs_stock": [],
        "share_of_raw": [],
        "episode_vs_plain": [],
        "mujoco_steps": [],
    }
    for _ in range(rounds):
        # Turns are as short as one episode, so that a disturbance affects all sides.
        times = np.zeros(6)
        for script, its in zip(scripts, others, strict=True):
            times[0] += time_stock(environment, script)
            times[1] += time_ours(task, script)
            times[2] += time_physics(task, script)
            times[5] += time_ours(other, its)
        for i, (controller, policy) in enumerate(zip(controllers, policies, strict=True)):
            times[3] += time_call(partial(plain_episode, environment, policy, i, 60))
            times[4] += time_call(partial(rollout, task, controller, generator(i), 60))
        ratios["step_vs_stock"].append(times[0] / times[1])
        ratios["share_of_raw"].append(times[2] / times[1])
        ratios["episode_vs_plain"].append(times[3] / times[4])
        ratios["mujoco_steps"].append(longer * times[1] / times[5])
    task.close()
    other.close()
    environment.close()
    return ratios


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    rounds = parser.parse_args().rounds
    torch.set_num_threads(1)
    figures = tabulated(STOCK, lambda name: measure_task(name, rounds))
    print(json.dumps({"bench": "rollout", "figures": figures}))


if __name__ == "__main__":
    main()
