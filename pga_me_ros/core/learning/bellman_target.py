"""The target of the critics: y of Eq. 5 of Nilsson & Cully (2021)."""

# Annotations must stay types: see `compiled`.
import torch
from torch import Tensor

from pga_me_ros.core.gradients.batched_mlp import BatchedMlp, forward, make_batched_mlp
from pga_me_ros.core.gradients.compiled import compiled
from pga_me_ros.core.learning.training_batch import Transitions
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.settings import Settings


class BellmanTarget:
    """Fills in y of batches, for one thread: it reads the targets in place and has its own buffers.

    Args:
        greedy_shape: Layers of the greedy controller.
        greedy: (1, P) float32, its target.
        critic_shape: Layers of each critic.
        critics: Targets of both critics, in parts that are computed at once: (E, P_critic) float32 each.
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
        self._greedy = make_batched_mlp(greedy_shape, greedy, rows, tanh=True)
        self._critics = [
            make_batched_mlp(critic_shape, target, rows, tanh=False) for target in critics
        ]
        self._inputs = greedy.new_zeros((1, rows, critic_shape.sizes[0]))
        obs_dim, act_dim = greedy_shape.sizes[0], greedy_shape.sizes[-1]
        self._states, self._actions = self._inputs.split([obs_dim, act_dim], dim=2)

    def fill(self, batches: list[Transitions], settings: Settings) -> None:
        """Fill in y of some batches (Alg. 4, lines 4-5).

        Args:
            batches: The batches.
            settings: Settings with the rates in force.
        """
        _fill(
            self._greedy,
            self._critics,
            batches,
            self._inputs,
            self._states,
            self._actions,
            settings.discount,
            clip=settings.target_action == "clip",
            mask=settings.terminal == "mask",
        )


@compiled
def _fill(
    greedy: BatchedMlp,
    critics: list[BatchedMlp],
    batches: list[Transitions],
    inputs: Tensor,
    states: Tensor,
    actions: Tensor,
    discount: float,
    clip: bool,
    mask: bool,
) -> None:
    for batch in batches:
        # The greedy controller's target acts in the next states, with noise.
        states.copy_(batch.next_states)
        torch.add(forward(greedy, batch.next_states), batch.noise, out=actions)
        if clip:
            actions.clamp_(-1.0, 1.0)
        first = forward(critics[0], inputs)
        second = forward(critics[1], inputs) if len(critics) > 1 else first
        torch.minimum(first[0], second[-1], out=batch.y)
        batch.y.mul_(discount)
        if mask:
            batch.y.mul_(batch.not_done)
        batch.y.add_(batch.rewards)
