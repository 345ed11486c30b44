"""300 critic steps of Table 1 against a plain torch TD3 loop, and against the arithmetic limit.

Run: `.venv/bin/python bench/critic.py [--rounds 5] [--threads 1]`; the last line is JSON. Every
figure is a ratio of two things measured in turn (A B A B ...) in this process. `two_workers` is the
speed with the second critic on a thread of its own, against one thread.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from _measure import product_rate, seconds, spread
from torch import nn

from pga_me_ros.core.critic import CriticTrainer
from pga_me_ros.core.replay import ReplayBuffer
from pga_me_ros.core.settings import Settings


@dataclass(frozen=True)
class WalkerDimensions:
    """Dimensions of QDWalker."""

    observation_dim: int = 22
    action_dim: int = 6


class TextbookTd3:
    """TD3 as a textbook writes it: modules, autograd, `torch.optim.Adam`, an array per column."""

    def __init__(self, spec: WalkerDimensions, settings: Settings, replay: ReplayBuffer) -> None:
        """Make the networks, and the arrays from the rows of a replay buffer."""
        obs, act = spec.observation_dim, spec.action_dim
        self.settings = settings
        rows = replay.rows(np.arange(len(replay)))
        columns = np.cumsum([obs, act, obs, 1])
        self.data = [torch.from_numpy(a.copy()) for a in np.split(rows, columns, axis=1)]
        actor_sizes = (obs, *settings.controller_hidden, act)
        critic_sizes = (obs + act, *settings.critic_hidden, 1)
        self.actor, self.actor_target = (perceptron(actor_sizes, tanh=True) for _ in range(2))
        self.critics = [perceptron(critic_sizes) for _ in range(2)]
        self.critic_targets = [perceptron(critic_sizes) for _ in range(2)]
        weights = [p for critic in self.critics for p in critic.parameters()]
        self.critic_adam = torch.optim.Adam(weights, settings.critic_learning_rate)
        self.actor_adam = torch.optim.Adam(self.actor.parameters(), settings.greedy_learning_rate)

    def train(self) -> None:
        """Take n_crit steps."""
        s = self.settings
        for t in range(1, s.n_crit + 1):
            indices = torch.randint(0, len(self.data[0]), (s.transition_batch,))
            state, action, next_state, reward, not_done = (d[indices] for d in self.data)
            with torch.no_grad():
                noise = (torch.randn_like(action) * s.smoothing_sigma).clamp(
                    -s.smoothing_clip, s.smoothing_clip
                )
                next_action = (self.actor_target(next_state) + noise).clamp(-1, 1)
                x = torch.cat([next_state, next_action], 1)
                q1, q2 = (target(x) for target in self.critic_targets)
                y = reward + not_done * s.discount * torch.min(q1, q2)
            x = torch.cat([state, action], 1)
            errors = [nn.functional.mse_loss(q(x), y) for q in self.critics]
            loss = errors[0] + errors[1]
            self.critic_adam.zero_grad()
            loss.backward()
            self.critic_adam.step()
            if t % s.target_period == 0:
                objective = -self.critics[0](torch.cat([state, self.actor(state)], 1)).mean()
                self.actor_adam.zero_grad()
                objective.backward()
                self.actor_adam.step()
                self.move_targets()

    def move_targets(self) -> None:
        """Move each target tensor by tau."""
        pairs = [
            (self.actor, self.actor_target),
            *zip(self.critics, self.critic_targets, strict=True),
        ]
        for online, target in pairs:
            for p, q in zip(online.parameters(), target.parameters(), strict=True):
                q.data.copy_(
                    self.settings.target_rate * p.data + (1 - self.settings.target_rate) * q.data
                )


def perceptron(sizes: tuple[int, ...], *, tanh: bool = False) -> nn.Sequential:
    """Return a torch perceptron with rectified hidden layers."""
    layers: list[nn.Module] = []
    for n_in, n_out in pairwise(sizes):
        layers += [nn.Linear(n_in, n_out), nn.ReLU()]
    return nn.Sequential(*layers[:-1], *([nn.Tanh()] if tanh else []))


def products(sizes: tuple[int, ...], rows: int) -> int:
    """Return the floating-point operations of one forward pass."""
    return sum(2 * rows * n_in * n_out for n_in, n_out in pairwise(sizes))


def needed_operations(spec: WalkerDimensions, s: Settings) -> float:
    """Return the operations that a critic step cannot do without, matrix products alone."""
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
    textbook = TextbookTd3(spec, settings, replay)
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
