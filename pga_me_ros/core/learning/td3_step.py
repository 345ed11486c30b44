"""A plain critic training step: Alg. 4 of Nilsson & Cully (2021), with torch's autograd.

Read this first. No run uses it; it is the reference for tests of `CriticTrainer`, which computes the same in a fraction
of the time. It is TD3 (Fujimoto et al. 2018) with the greedy controller as the actor.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.settings import Settings


@dataclass(frozen=True)
class TransitionBatch:
    """N transitions from the replay buffer.

    Attributes:
        states: (N, obs_dim), s.
        actions: (N, act_dim), a.
        rewards: (N, 1), r.
        next_states: (N, obs_dim), s'.
        not_done: (N, 1), 0 where the robot fell, else 1.
    """

    states: Tensor
    actions: Tensor
    rewards: Tensor
    next_states: Tensor
    not_done: Tensor


class TextbookTd3:
    """The greedy controller pi_phic, the critics Q_theta1 and Q_theta2, their targets and their optimizers.

    Args:
        greedy: Network from (N, obs_dim) states to (N, act_dim) actions within ±1.
        critics: Two networks from (N, obs_dim + act_dim) states and actions to (N, 1) values.
        settings: Settings of the run.
    """

    def __init__(self, greedy: nn.Module, critics: list[nn.Module], settings: Settings) -> None:
        """Copy the networks into their targets (Alg. 3, lines 3-5)."""
        self.greedy, self.critics = greedy, nn.ModuleList(critics)
        self.greedy_target, self.critic_targets = copy.deepcopy((self.greedy, self.critics))
        self.settings = settings
        self.critic_adam = torch.optim.Adam(
            self.critics.parameters(), settings.critic_learning_rate
        )
        self.greedy_adam = torch.optim.Adam(self.greedy.parameters(), settings.greedy_learning_rate)

    def step(self, number: int, batch: TransitionBatch, normal: Tensor) -> None:
        """Take one training step (Alg. 4, lines 3-11).

        Args:
            number: Number t of the step, from 1.
            batch: N transitions (line 3).
            normal: (N, act_dim) standard normal numbers, for the smoothing noise (line 4).
        """
        self.critic_adam.zero_grad()
        self.critic_loss(batch, self.target(batch, normal)).backward()
        self.critic_adam.step()
        if number % self.settings.target_period == 0:
            self.greedy_adam.zero_grad()
            self.greedy_loss(batch).backward()
            self.greedy_adam.step()
            self.move_targets()

    @torch.no_grad()
    def target(self, batch: TransitionBatch, normal: Tensor) -> Tensor:
        """Return the (N, 1) target y of the critics: the first part of Eq. 5 (Alg. 4, lines 4-5)."""
        s = self.settings
        noise = (s.smoothing_sigma * normal).clamp(-s.smoothing_clip, s.smoothing_clip)
        next_actions = self.greedy_target(batch.next_states) + noise
        if s.target_action == "clip":
            next_actions = next_actions.clamp(-1, 1)
        next_values = torch.minimum(*values(self.critic_targets, batch.next_states, next_actions))
        if s.terminal == "mask":
            next_values = next_values * batch.not_done
        return batch.rewards + s.discount * next_values

    def critic_loss(self, batch: TransitionBatch, y: Tensor) -> Tensor:
        """Return the sum of both critics' mean squared errors: the rest of Eq. 5 (Alg. 4, line 6)."""
        q1, q2 = values(self.critics, batch.states, batch.actions)
        return mse_loss(q1, y) + mse_loss(q2, y)

    def greedy_loss(self, batch: TransitionBatch) -> Tensor:
        """Return minus the mean of Q1(s, pi(s)): its gradient is that of Eq. 1 (Alg. 4, lines 8-9)."""
        q1, _ = values(self.critics, batch.states, self.greedy(batch.states))
        return -q1.mean()

    @torch.no_grad()
    def move_targets(self) -> None:
        """Move each target by tau towards its network (Eq. 4; Alg. 4, lines 10-11)."""
        tau = self.settings.target_rate
        networks, targets = [*self.critics, self.greedy], [*self.critic_targets, self.greedy_target]
        for network, target in zip(networks, targets, strict=True):
            for p, p_target in zip(network.parameters(), target.parameters(), strict=True):
                p_target.copy_(tau * p + (1 - tau) * p_target)


def values(critics: nn.ModuleList, states: Tensor, actions: Tensor) -> list[Tensor]:
    """Return the (N, 1) values of actions in states, for each critic."""
    inputs = torch.cat((states, actions), 1)
    return [critic(inputs) for critic in critics]


def perceptron(shape: MlpShape, parameters: Float32Array, *, tanh: bool = False) -> nn.Module:
    """Return a network as a torch module.

    Args:
        shape: Layers; the hidden ones are rectified.
        parameters: (P,) float32.
        tanh: Whether the output goes through tanh (controllers) or is linear (critics).
    """
    layers: list[nn.Module] = []
    for weights, biases in shape.layers(parameters):
        linear = nn.Linear(weights.shape[1], weights.shape[0])
        linear.weight.data.copy_(torch.from_numpy(weights))
        linear.bias.data.copy_(torch.from_numpy(biases))
        layers += [linear, nn.ReLU()]
    return nn.Sequential(*layers[:-1], *([nn.Tanh()] if tanh else []))
