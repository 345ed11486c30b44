"""The work that `same_speed.py` times, as a program; no bench itself.

For each name on standard input it does that work and prints the seconds taken. It runs once per source tree, by that
tree's own Python, and stays alive between rounds. What has moved since the older tree is looked up at both addresses.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import torch
from _measure import seconds

import pga_me_ros
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.registry import load_task
from pga_me_ros.tasks.rollout import rollout


def found(*addresses: str) -> Any:
    """Return the first of some objects that exists, each given as 'module:name' below `pga_me_ros`."""
    for address in addresses:
        module, name = address.split(":")
        try:
            return getattr(importlib.import_module(f"pga_me_ros.{module}"), name)
        except (ImportError, AttributeError):
            continue
    raise SystemExit(f"none of {', '.join(addresses)} exists in this tree")


CriticTrainer = found("core.learning.critic_trainer:CriticTrainer", "core.critic:CriticTrainer")
ReplayBuffer = found("core.learning.replay_buffer:ReplayBuffer", "core.replay:ReplayBuffer")
pg_variation = found(
    "core.variation.policy_gradient:pg_variation", "core.pg_variation:pg_variation"
)
MlpShape = found("core.networks.mlp:MlpShape", "core.policy:MlpShape")
random_critic = found("core.networks.mlp:random_critic", "core.policy:random_critic")
random_parameters = found("core.networks.mlp:random_parameters", "core.policy:random_parameters")
Controller = found("core.networks.controller:MlpController", "core.policy:Controller")


@dataclass(frozen=True)
class WalkerDimensions:
    """Dimensions of QDWalker."""

    observation_dim: int = 22
    action_dim: int = 6


def episodes(name: str, count: int) -> Callable[[], object]:
    """Return a call that runs episodes of random controllers."""
    task = load_task(name)()
    shape = MlpShape((task.spec.observation_dim, 128, 128, task.spec.action_dim))
    controllers = [
        Controller(shape, random_parameters(shape, np.random.default_rng(i))) for i in range(count)
    ]

    def work() -> None:
        for i, controller in enumerate(controllers):
            rollout(task, controller, np.random.default_rng(i))

    return work


def critic_steps() -> Callable[[], object]:
    """Return a call that takes the critic steps of a generation of Table 1, from 100,000 random transitions."""
    rng, spec, settings = np.random.default_rng(0), WalkerDimensions(), Settings()
    replay = ReplayBuffer(100_000, spec.observation_dim, spec.action_dim)
    for _ in range(1000):
        replay.add_episode(
            rng.standard_normal((101, spec.observation_dim), np.float32),
            np.tanh(rng.standard_normal((100, spec.action_dim), np.float32)),
            rng.standard_normal(100, np.float32),
            terminated=True,
        )
    return partial(CriticTrainer(spec, settings, 1).train, replay, settings, 1)


def pg_offspring() -> Callable[[], object]:
    """Return a call that makes 50 offspring by policy gradients, 10 steps each."""
    rng = np.random.default_rng(0)
    controller, critic = MlpShape((22, 128, 128, 6)), MlpShape((28, 256, 256, 1))
    parents = np.stack([random_parameters(controller, rng) for _ in range(50)])
    states = rng.standard_normal((10, 256, 22), np.float32)
    weights = random_critic(critic, rng)
    return partial(pg_variation, parents, weights, states, 1e-3, controller, critic, workers=1)


WORK: dict[str, Callable[[], Callable[[], object]]] = {
    "rollout, short episodes": partial(episodes, "qd_walker", 150),
    "rollout, long episodes": partial(episodes, "qd_half_cheetah", 3),
    "critic": critic_steps,
    "pg_variation": pg_offspring,
}
"""What is timed, by name; each is prepared and done once before the first round."""


def main() -> None:
    """Prepare everything, then do what standard input names."""
    torch.set_num_threads(1)
    ready = {name: prepare() for name, prepare in WORK.items()}
    for work in ready.values():
        work()
    print(pga_me_ros.__file__, flush=True)
    print("\n".join(WORK), flush=True)
    print("ready", flush=True)
    for line in sys.stdin:
        print(seconds(ready[line.strip()]), flush=True)


if __name__ == "__main__":
    main()
