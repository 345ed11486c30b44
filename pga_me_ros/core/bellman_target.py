"""What the critics should return: y of Eq. 5 of Nilsson & Cully (2021)."""

from __future__ import annotations

import torch
from torch import Tensor

from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.torch_nets import MlpStack
from pga_me_ros.core.training_batch import TrainingBatch


class BellmanTarget:
    """Fills in y of batches, for one thread: it reads the targets in place, its buffers are its own.

    Args:
        greedy_shape: Layers of the greedy controller.
        greedy: (1, P) float32, its target.
        critic_shape: Layers of each critic.
        critics: Targets of both critics, (E, P_critic) float32 each: those that are computed at once.
        rows: N, transitions per batch.
    """

    def __init__(
        self,
        greedy_shape: MlpShape,
        greedy: Tensor,
        critic_shape: MlpShape,
        critics: list[Tensor],
        rows: int,
    ) -> None:
        """Reserve the memory."""
        self._greedy = MlpStack(greedy_shape, greedy, rows, tanh=True)
        self._critics = [MlpStack(critic_shape, target, rows, tanh=False) for target in critics]
        self._inputs = greedy.new_zeros((1, rows, critic_shape.sizes[0]))
        obs_dim, act_dim = greedy_shape.sizes[0], greedy_shape.sizes[-1]
        self._states, self._actions = self._inputs.split([obs_dim, act_dim], dim=2)

    def fill(self, batches: list[TrainingBatch], settings: Settings) -> None:
        """Fill in y of some batches (Alg. 4, lines 4-5).

        Args:
            batches: The batches.
            settings: Settings with the rates in force.
        """
        for batch in batches:
            self._act(batch, clip=settings.target_action == "clip")
            q1, q2 = (q for stack in self._critics for q in stack.forward(self._inputs))
            torch.minimum(q1, q2, out=batch.y)
            batch.y.mul_(settings.discount)
            if settings.terminal == "mask":
                batch.y.mul_(batch.not_done)
            batch.y.add_(batch.rewards)

    def _act(self, batch: TrainingBatch, *, clip: bool) -> None:
        """Have the greedy controller's target act in the next states, with noise."""
        self._states.copy_(batch.next_states)
        torch.add(self._greedy.forward(batch.next_states), batch.noise, out=self._actions)
        if clip:
            self._actions.clamp_(-1.0, 1.0)
