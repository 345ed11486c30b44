"""Critic training compared with two float64 references: NumPy with hand-derived gradients, and `td3_step`.

Both draw the same transitions and noise from the generator of (seed, CRITIC_TRAINING, generation):
in each step N indices, then (N, act_dim) normal numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
import torch

from pga_me_ros.core.learning.critic_trainer import CriticTrainer
from pga_me_ros.core.learning.replay_buffer import ReplayBuffer
from pga_me_ros.core.learning.td3_step import TextbookTd3, TransitionBatch, perceptron
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings

OBS, ACT = 5, 3
# Large rates, so that a wrong step exceeds float32 rounding by far.
BASE = Settings(
    seed=11,
    n_crit=9,
    target_period=2,
    transition_batch=32,
    controller_hidden=(12, 10),
    critic_hidden=(14, 16),
    critic_learning_rate=3e-3,
    greedy_learning_rate=2e-3,
    target_rate=0.1,
    smoothing_sigma=0.4,
    device="auto",  # a GPU must give the textbook's result, too
)
CASES = {
    "paper": BASE,
    "bootstrap": BASE.replace(terminal="bootstrap"),
    "free target action": BASE.replace(
        target_action="free", smoothing_sigma=2.0, smoothing_clip=2.0
    ),
    "every step": BASE.replace(target_period=1, n_crit=5),
    "every third step": BASE.replace(target_period=3),
    "one hidden layer": BASE.replace(controller_hidden=(6,), critic_hidden=(20,)),
}


@dataclass(frozen=True)
class Robot:
    observation_dim: int = OBS
    action_dim: int = ACT


def filled_replay():
    rng = np.random.default_rng(5)
    replay = ReplayBuffer(500, OBS, ACT)
    for steps in (40, 3, 60, 1, 25, 2, 4):
        replay.add_episode(
            rng.standard_normal((steps + 1, OBS), np.float32),
            np.tanh(rng.standard_normal((steps, ACT), np.float32)),
            rng.standard_normal(steps, np.float32),
            terminated=True,
        )
    return replay


def draws(replay, settings, generation):
    """Yield (s, a, s', r, not_done, standard normal numbers) of each step in float64."""
    rng = generator(settings.seed, Purpose.CRITIC_TRAINING, generation)
    n = settings.transition_batch
    for _ in range(settings.n_crit):
        rows = replay.rows(rng.integers(0, len(replay), n)).astype(np.float64)
        normal = rng.standard_normal((n, ACT), np.float32)
        columns = np.cumsum([OBS, ACT, OBS, 1])
        yield (*np.split(rows, columns, axis=1), normal.astype(np.float64))


class NumpyMlp:
    """Perceptron in float64 with hand-derived gradients."""

    def __init__(self, sizes, flat, *, tanh):
        self.tanh, self.tensors, offset = tanh, [], 0
        for n_in, n_out in pairwise(sizes):
            for shape in ((n_out, n_in), (n_out,)):
                size = int(np.prod(shape))
                self.tensors.append(flat[offset : offset + size].astype(np.float64).reshape(shape))
                offset += size
        self.m = [np.zeros_like(t) for t in self.tensors]
        self.v = [np.zeros_like(t) for t in self.tensors]
        self.steps = 0

    def forward(self, x):
        self.signals = [x]
        for i in range(0, len(self.tensors), 2):
            z = self.signals[-1] @ self.tensors[i].T + self.tensors[i + 1]
            if i + 2 < len(self.tensors):
                z = np.maximum(z, 0)
            elif self.tanh:
                z = np.tanh(z)
            self.signals.append(z)
        return self.signals[-1]

    def backward(self, d):
        """Return gradients with respect to the tensors and to the input."""
        gradients = [None] * len(self.tensors)
        if self.tanh:
            d = d * (1 - self.signals[-1] ** 2)
        for i in reversed(range(0, len(self.tensors), 2)):
            x = self.signals[i // 2]
            gradients[i], gradients[i + 1] = d.T @ x, d.sum(axis=0)
            d = d @ self.tensors[i]
            if i:
                d = d * (x > 0)
        return gradients, d

    def adam(self, gradients, rate):
        self.steps += 1
        for t, g, m, v in zip(self.tensors, gradients, self.m, self.v, strict=True):
            m += 0.1 * (g - m)
            v += 0.001 * (g**2 - v)
            t -= rate * (m / (1 - 0.9**self.steps)) / (np.sqrt(v / (1 - 0.999**self.steps)) + 1e-8)

    def follow(self, online, tau):
        for mine, theirs in zip(self.tensors, online.tensors, strict=True):
            mine += tau * (theirs - mine)

    def flat(self):
        return np.concatenate([t.ravel() for t in self.tensors])


def numpy_training(state, trainer, replay, settings, generation):
    """Carry out Alg. 4 step by step; return the flat networks by name."""

    def network(flat, greedy=False):
        shape = trainer.greedy_shape if greedy else trainer.critic_shape
        return NumpyMlp(shape.sizes, flat, tanh=greedy)

    critics = [network(flat) for flat in state["critics"]]
    targets = [network(flat) for flat in state["critic_targets"]]
    greedy = network(state["greedy"][0], greedy=True)
    greedy_target = network(state["greedy_target"][0], greedy=True)
    n, s = settings.transition_batch, settings
    for t, (states, actions, nexts, rewards, not_done, normal) in enumerate(
        draws(replay, settings, generation), start=1
    ):
        noise = np.clip(s.smoothing_sigma * normal, -s.smoothing_clip, s.smoothing_clip)
        next_actions = greedy_target.forward(nexts) + noise
        if s.target_action == "clip":
            next_actions = np.clip(next_actions, -1, 1)
        q = [target.forward(np.hstack((nexts, next_actions))) for target in targets]
        mask = not_done if s.terminal == "mask" else 1.0
        y = rewards + s.discount * mask * np.minimum(*q)
        for critic in critics:
            error = critic.forward(np.hstack((states, actions))) - y
            critic.adam(critic.backward(2 * error / n)[0], s.critic_learning_rate)
        if t % s.target_period == 0:
            critics[0].forward(np.hstack((states, greedy.forward(states))))
            _, by_input = critics[0].backward(np.full((n, 1), -1 / n))
            greedy.adam(greedy.backward(by_input[:, OBS:])[0], s.greedy_learning_rate)
            for target, online in zip([*targets, greedy_target], [*critics, greedy], strict=True):
                target.follow(online, s.target_rate)
    return {
        "critics": np.stack([c.flat() for c in critics]),
        "critic_targets": np.stack([c.flat() for c in targets]),
        "greedy": greedy.flat()[None],
        "greedy_target": greedy_target.flat()[None],
    }


def reference(state, trainer, settings):
    """Return the readable version of Alg. 4 in float64, with the initial networks of a trainer."""
    greedy = perceptron(trainer.greedy_shape, state["greedy"][0], tanh=True)
    critics = [perceptron(trainer.critic_shape, flat) for flat in state["critics"]]
    return TextbookTd3(greedy.double(), [critic.double() for critic in critics], settings)


def flat_module(module):
    return torch.nn.utils.parameters_to_vector(module.parameters()).detach().numpy()


def reference_training(state, trainer, replay, settings, generation):
    td3 = reference(state, trainer, settings)
    for t, batch in enumerate(draws(replay, settings, generation), start=1):
        states, actions, nexts, rewards, not_done, normal = map(torch.from_numpy, batch)
        td3.step(t, TransitionBatch(states, actions, rewards, nexts, not_done), normal)
    return {
        "critics": np.stack([flat_module(critic) for critic in td3.critics]),
        "critic_targets": np.stack([flat_module(target) for target in td3.critic_targets]),
        "greedy": flat_module(td3.greedy)[None],
        "greedy_target": flat_module(td3.greedy_target)[None],
    }


@pytest.mark.parametrize("oracle", [numpy_training, reference_training], ids=["numpy", "reference"])
@pytest.mark.parametrize("case", CASES)
def test_networks_equal_the_oracle(oracle, case):
    settings, replay = CASES[case], filled_replay()
    trainer = CriticTrainer(Robot(), settings)
    start = trainer.state()
    wanted = oracle(start, trainer, replay, settings, generation=7)
    trainer.train(replay, settings, 7)
    got = trainer.state()
    for name, flat in wanted.items():
        assert np.abs(flat - start[name]).max() > 1e-3, name
        np.testing.assert_allclose(got[name], flat, rtol=0, atol=2e-5, err_msg=name)
