"""300 critic steps of Table 1 compared with a plain torch TD3 loop, and with the arithmetic limit.

Run: `.venv/bin/python bench/critic.py [--rounds 5] [--threads 1]`; the last line is JSON. Every
figure is a ratio of two things measured in turn (A B A B ...) in this process. `two_workers` is the
speed with the second critic on its own thread, relative to one thread.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import torch
from _measure import product_rate, seconds, spread

from pga_me_ros.core.learning.critic_trainer import CriticTrainer
from pga_me_ros.core.learning.replay_buffer import ReplayBuffer
from pga_me_ros.core.learning.td3_step import TextbookTd3, TransitionBatch, perceptron
from pga_me_ros.core.networks.mlp import random_critic, random_parameters
from pga_me_ros.core.networks.shapes import controller_shape, critic_shape
from pga_me_ros.core.settings import Settings


@dataclass(frozen=True)
class WalkerDimensions:
    """Dimensions of QDWalker."""

    observation_dim: int = 22
    action_dim: int = 6


class Textbook:
    """The readable version of the training, `td3_step.TextbookTd3`, with one array per column of the replay buffer."""

    def __init__(self, spec: WalkerDimensions, settings: Settings, replay: ReplayBuffer) -> None:
        """Make the networks, and the arrays from the rows of a replay buffer."""
        obs, act = spec.observation_dim, spec.action_dim
        rows = replay.rows(np.arange(len(replay)))
        columns = np.split(rows, np.cumsum([obs, act, obs, 1]), axis=1)
        states, actions, next_states, rewards, not_done = (
            torch.from_numpy(column.copy()) for column in columns
        )
        self._data = TransitionBatch(states, actions, rewards, next_states, not_done)
        rng, critics = np.random.default_rng(0), critic_shape(spec, settings)
        controllers = controller_shape(spec, settings)
        self._td3 = TextbookTd3(
            perceptron(controllers, random_parameters(controllers, rng), tanh=True),
            [perceptron(critics, random_critic(critics, rng)) for _ in range(2)],
            settings,
        )
        self._settings = settings

    def train(self) -> None:
        """Take n_crit steps."""
        data, rows = self._data, self._settings.transition_batch
        for t in range(1, self._settings.n_crit + 1):
            i = torch.randint(0, len(data.states), (rows,))
            batch = TransitionBatch(*(getattr(data, f.name)[i] for f in fields(data)))
            self._td3.step(t, batch, torch.randn_like(batch.actions))


def products(sizes: tuple[int, ...], rows: int) -> int:
    """Return the floating-point operations of one forward pass."""
    return sum(2 * rows * n_in * n_out for n_in, n_out in pairwise(sizes))


def needed_operations(spec: WalkerDimensions, s: Settings) -> float:
    """Return the operations that a critic step needs at least, counting only matrix products."""
    n, obs, act = s.transition_batch, spec.observation_dim, spec.action_dim
    actor_sizes, critic_sizes = (
        (obs, *s.controller_hidden, act),
        (obs + act, *s.critic_hidden, 1),
    )
    actor, critic = products(actor_sizes, n), products(critic_sizes, n)
    critic_below = critic - 2 * n * critic_sizes[0] * critic_sizes[1]
    actor_below = actor - 2 * n * actor_sizes[0] * actor_sizes[1]
    critics = actor + 2 * critic + 2 * (2 * critic + critic_below)
    action_columns = 2 * n * act * critic_sizes[1]
    greedy = actor + critic + critic_below + action_columns + actor + actor_below
    return critics + greedy / s.target_period


def filled_replay(spec: WalkerDimensions, transitions: int) -> ReplayBuffer:
    """Return a buffer with random transitions."""
    rng = np.random.default_rng(0)
    replay = ReplayBuffer(transitions, spec.observation_dim, spec.action_dim)
    for _ in range(transitions // 100):
        replay.add_episode(
            rng.standard_normal((101, spec.observation_dim), np.float32),
            np.tanh(rng.standard_normal((100, spec.action_dim), np.float32)),
            rng.standard_normal(100, np.float32),
            terminated=True,
        )
    return replay


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--transitions", type=int, default=300_000)
    arguments = parser.parse_args()
    spec, settings = WalkerDimensions(), Settings(torch_threads=arguments.threads)
    torch.set_num_threads(arguments.threads)
    replay = filled_replay(spec, arguments.transitions)
    ours, together = (CriticTrainer(spec, settings, workers) for workers in (1, 2))
    textbook = Textbook(spec, settings, replay)
    for trainer in (ours, together):
        trainer.train(replay, settings.replace(n_crit=20), 0)
    operations = needed_operations(spec, settings) * settings.n_crit
    speedups, shares, textbook_shares, of_two = [], [], [], []
    for generation in range(1, arguments.rounds + 1):
        rate_before = product_rate()
        a = seconds(lambda g=generation: ours.train(replay, settings, g))  # type: ignore[misc]
        rate = (rate_before + product_rate()) / 2
        b = seconds(textbook.train)
        c = seconds(lambda g=generation: together.train(replay, settings, g))  # type: ignore[misc]
        of_two.append(a / c)
        speedups.append(b / a)
        shares.append(operations / a / rate)
        textbook_shares.append(operations / b / rate)
        print(
            f"ours {a:.2f} s, with two workers {c:.2f} s, textbook {b:.2f} s, matrix products {rate / 1e9:.0f} GFLOP/s"
        )
    figures = {
        "speedup_over_textbook": spread(speedups),
        "share_of_product_rate": spread(shares),
        "textbook_share_of_product_rate": spread(textbook_shares),
        "two_workers": spread(of_two),
    }
    for name, values in figures.items():
        print(f"{name:32} {values['median']:.2f}  ({values['min']:.2f} to {values['max']:.2f})")
    print(json.dumps({"bench": "critic", "figures": figures}))


if __name__ == "__main__":
    main()
