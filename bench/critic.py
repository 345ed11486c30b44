"""300 critic steps of Table 1 against a plain torch TD3 loop, and against the arithmetic limit; the same for DCRL.

Run: `.venv/bin/python bench/critic.py [--rounds 5] [--threads 1] [--cases table_1 dcrl]`; the last line is JSON. Every
figure is a ratio of two things measured in turn (A B A B ...) in this process. `two_workers` is the
speed with the second critic on a thread of its own, against one thread. `dcrl` has the batches of 100 and the networks,
conditioned on descriptors, of DCRL-MAP-Elites; its plain loop is `textbook_step.TextbookDcrl`.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np
import torch
from _measure import product_rate, seconds, spread

from pga_me_ros.core.algorithms.dcrl.textbook_step import DescribedBatch, TextbookDcrl
from pga_me_ros.core.learning.critic_trainer import CriticTrainer
from pga_me_ros.core.learning.replay_buffer import ReplayBuffer
from pga_me_ros.core.learning.td3_step import TextbookTd3, TransitionBatch, perceptron
from pga_me_ros.core.networks.conditioned import ConditionedDimensions
from pga_me_ros.core.networks.mlp import random_critic, random_parameters
from pga_me_ros.core.networks.shapes import RobotDimensions, controller_shape, critic_shape
from pga_me_ros.core.settings import Settings


@dataclass(frozen=True)
class WalkerDimensions:
    """Dimensions of QDWalker."""

    observation_dim: int = 22
    action_dim: int = 6
    descriptor_low: tuple[float, ...] = (0.0, 0.0)
    descriptor_high: tuple[float, ...] = (1.0, 1.0)


WALKER = WalkerDimensions()
CASES: dict[str, tuple[RobotDimensions, Settings]] = {
    "table_1": (WALKER, Settings()),
    "dcrl": (
        ConditionedDimensions.of(WALKER),
        Settings(algorithm="dcrl_map_elites", n_crit=Settings().n_crit),
    ),
}
"""What the networks see, and how they are trained."""


class Textbook:
    """The readable form of the same training, with an array per column of the replay buffer."""

    def __init__(self, spec: RobotDimensions, settings: Settings, replay: ReplayBuffer) -> None:
        """Make the networks, and the arrays from the rows of a replay buffer."""
        self._data, kind = data_of(spec, replay), TextbookTd3
        if settings.algorithm == "dcrl_map_elites":
            self._data, kind = described(self._data), TextbookDcrl
        rng, critics = np.random.default_rng(0), critic_shape(spec, settings)
        controllers = controller_shape(spec, settings)
        self._td3 = kind(
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
            batch = type(data)(*(getattr(data, f.name)[i] for f in fields(data)))
            self._td3.step(t, batch, torch.randn_like(batch.actions))


def data_of(spec: RobotDimensions, replay: ReplayBuffer) -> TransitionBatch:
    """Return all transitions of a replay buffer."""
    obs, act = spec.observation_dim, spec.action_dim
    rows = replay.rows(np.arange(len(replay)))
    columns = np.split(rows, np.cumsum([obs, act, obs, 1]), axis=1)
    states, actions, next_states, rewards, not_done = (
        torch.from_numpy(column.copy()) for column in columns
    )
    return TransitionBatch(states, actions, rewards, next_states, not_done)


def described(data: TransitionBatch) -> DescribedBatch:
    """Return transitions with the descriptors apart from the states; all episodes achieved the same."""
    d = len(WALKER.descriptor_low)
    states, aims = data.states[:, :-d].clone(), data.states[:, -d:].clone()
    after = data.next_states[:, :-d].clone()
    return DescribedBatch(
        states, data.actions, data.rewards, after, data.not_done, torch.zeros_like(aims), aims
    )


def products(sizes: tuple[int, ...], rows: int) -> int:
    """Return the floating-point operations of one forward pass."""
    return sum(2 * rows * n_in * n_out for n_in, n_out in pairwise(sizes))


def needed_operations(spec: RobotDimensions, s: Settings) -> float:
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


def filled_replay(spec: RobotDimensions, transitions: int) -> ReplayBuffer:
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


def measure(
    spec: RobotDimensions, settings: Settings, rounds: int, transitions: int
) -> dict[str, dict[str, float]]:
    """Measure one case in turn, and return its figures."""
    replay = filled_replay(spec, transitions)
    ours, together = (CriticTrainer(spec, settings, workers) for workers in (1, 2))
    textbook = Textbook(spec, settings, replay)
    for trainer in (ours, together):
        trainer.train(replay, settings.replace(n_crit=20), 0)
    operations = needed_operations(spec, settings) * settings.n_crit
    speedups, shares, textbook_shares, of_two = [], [], [], []
    for generation in range(1, rounds + 1):
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
    return {
        "speedup_over_textbook": spread(speedups),
        "share_of_product_rate": spread(shares),
        "textbook_share_of_product_rate": spread(textbook_shares),
        "two_workers": spread(of_two),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--transitions", type=int, default=300_000)
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    figures: dict[str, dict[str, float]] = {}
    for case in arguments.cases:
        spec, settings = CASES[case]
        print(f"{case}:")
        settings = settings.replace(torch_threads=arguments.threads)
        of_case = measure(spec, settings, arguments.rounds, arguments.transitions)
        for name, values in of_case.items():
            print(f"{name:32} {values['median']:.2f}  ({values['min']:.2f} to {values['max']:.2f})")
        prefix = "" if case == "table_1" else f"{case}_"
        figures |= {f"{prefix}{name}": values for name, values in of_case.items()}
    print(json.dumps({"bench": "critic", "figures": figures}))


if __name__ == "__main__":
    main()
