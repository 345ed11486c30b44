"""A textbook training step of DCRL-MAP-Elites, with torch's autograd (Faldor et al. 2025).

Runs don't use it: read it first, and `DcrlLearner` is tested against it. It is `TextbookTd3` with a descriptor as input
of every network, and rewards weighted by the similarity of achieved and intended descriptor.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from pga_me_ros.core.learning.td3_step import TextbookTd3, TransitionBatch


@dataclass(frozen=True)
class DescribedBatch(TransitionBatch):
    """N transitions with the descriptors of their episodes, scaled to ±1.

    Attributes:
        achieved: (N, d), d.
        intended: (N, d), d'.
    """

    achieved: Tensor
    intended: Tensor


class TextbookDcrl(TextbookTd3):
    """The actor pi_phi(s | d), the critics Q_theta1(s, a | d) and Q_theta2, their targets and their optimizers.

    Args:
        greedy: The actor, from (N, obs_dim + d) states with descriptors to (N, act_dim) actions within ±1.
        critics: Two networks from (N, obs_dim + d + act_dim) states with descriptors and actions to (N, 1) values.
        settings: Settings of the run.
    """

    @torch.no_grad()
    def target(self, batch: TransitionBatch, normal: Tensor) -> Tensor:
        """Return y (N, 1) = S(d, d') r + gamma min_i Q'_i(s', pi'(s' | d') + noise | d')."""
        assert isinstance(batch, DescribedBatch)
        s = self.settings
        noise = (s.smoothing_sigma * normal).clamp(-s.smoothing_clip, s.smoothing_clip)
        next_actions = self.act(self.greedy_target, batch.next_states, batch.intended) + noise
        if s.target_action == "clip":
            next_actions = next_actions.clamp(-1, 1)
        next_values = torch.minimum(
            *self.values(self.critic_targets, batch.next_states, batch.intended, next_actions)
        )
        if s.terminal == "mask":
            next_values = next_values * batch.not_done
        distance = torch.linalg.vector_norm(batch.achieved - batch.intended, dim=1, keepdim=True)
        similarity = torch.exp(-distance / s.similarity_length)
        return similarity * batch.rewards + s.discount * next_values

    def critic_loss(self, batch: TransitionBatch, y: Tensor) -> Tensor:
        """Return the sum of both critics' mean squared errors."""
        assert isinstance(batch, DescribedBatch)
        q1, q2 = self.values(self.critics, batch.states, batch.intended, batch.actions)
        return mse_loss(q1, y) + mse_loss(q2, y)

    def greedy_loss(self, batch: TransitionBatch) -> Tensor:
        """Return minus the mean of Q1(s, pi(s | d') | d')."""
        assert isinstance(batch, DescribedBatch)
        actions = self.act(self.greedy, batch.states, batch.intended)
        q1, _ = self.values(self.critics, batch.states, batch.intended, actions)
        return -q1.mean()

    @staticmethod
    def act(actor: nn.Module, states: Tensor, descriptors: Tensor) -> Tensor:
        """Return the actions (N, act_dim) of an actor conditioned on descriptors."""
        actions: Tensor = actor(torch.cat((states, descriptors), 1))
        return actions

    @staticmethod
    def values(
        critics: nn.ModuleList, states: Tensor, descriptors: Tensor, actions: Tensor
    ) -> list[Tensor]:
        """Return each critic's values (N, 1) of actions in states, conditioned on descriptors."""
        inputs = torch.cat((states, descriptors, actions), 1)
        return [critic(inputs) for critic in critics]
