"""The policy gradient (Eq. 1 of Nilsson & Cully 2021): which way a controller's actions gain in value."""

from __future__ import annotations

from torch import Tensor

from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.torch_nets import MlpStack


class ValueAscent:
    """Gradients of the mean of Q1(s, pi(s)) by the parameters of E controllers.

    Args:
        controllers: (E, P) float32, read in place.
        controller_shape: Layers of each controller.
        critics: (E, P_critic) float32, the critic of each controller; read in place.
        critic_shape: Layers of each critic.
        rows: N, states per batch.
        weight: What each state counts in the mean; None for 1/N.

    Attributes:
        gradient: (E, P), the outcome of the last `climb`.
    """

    def __init__(
        self,
        controllers: Tensor,
        controller_shape: MlpShape,
        critics: Tensor,
        critic_shape: MlpShape,
        rows: int,
        weight: float | None = None,
    ) -> None:
        """Reserve the memory."""
        self._controllers = MlpStack(controller_shape, controllers, rows, tanh=True)
        self._critics = MlpStack(critic_shape, critics, rows, tanh=False)
        self.gradient = self._controllers.gradient
        self._obs_dim = controller_shape.sizes[0]
        size, act_dim = len(controllers), controller_shape.sizes[-1]
        self._inputs = controllers.new_zeros((size, rows, critic_shape.sizes[0]))
        self._states, self._actions = self._inputs.split([self._obs_dim, act_dim], dim=2)
        # A product with so few columns is several times as fast when it writes them as rows.
        self._by_action = controllers.new_zeros((size, act_dim, rows)).transpose(1, 2)
        self._weights = controllers.new_full((1, rows, 1), 1.0 / rows if weight is None else weight)

    def climb(self, states: Tensor) -> Tensor:
        """Fill `gradient` for states (E or 1, N, obs_dim); return the values (E, N, 1) before the step."""
        self._states.copy_(states)
        self._actions.copy_(self._controllers.forward(states))
        values = self._critics.forward(self._inputs)
        self._critics.input_gradient(self._weights, self._obs_dim, out=self._by_action)
        self._controllers.backward(states, self._by_action)
        return values
