"""The policy gradient (Eq. 1 of Nilsson & Cully 2021): how to change a controller so that its actions gain value."""

# Annotations must stay types: see `compiled`.
from typing import NamedTuple

from torch import Tensor

from pga_me_ros.core.gradients.adam import Adam, adam_step
from pga_me_ros.core.gradients.batched_mlp import (
    BatchedMlp,
    backward,
    forward,
    input_gradient,
    make_batched_mlp,
)
from pga_me_ros.core.gradients.compiled import compiled
from pga_me_ros.core.networks.mlp import MlpShape


class ValueAscent(NamedTuple):
    """E controllers, the critic of each, and the buffers for a policy gradient; made by `make_value_ascent`.

    Attributes:
        controllers: The controllers.
        critics: Their critics.
        inputs: (E, N, obs_dim + act_dim), inputs of the critics.
        states: (E, N, obs_dim), a view of them.
        actions: (E, N, act_dim), a view of them.
        action_weights: (E, n, act_dim), the actions' columns of the weights of the critics' first layer.
        by_action: (E, N, act_dim), derivatives of the objective with respect to the actions.
        weights: (1, N, 1), weight of each state in the mean.
    """

    controllers: BatchedMlp
    critics: BatchedMlp
    inputs: Tensor
    states: Tensor
    actions: Tensor
    action_weights: Tensor
    by_action: Tensor
    weights: Tensor


def make_value_ascent(
    controllers: Tensor,
    controller_shape: MlpShape,
    critics: Tensor,
    critic_shape: MlpShape,
    rows: int,
    weight: float | None = None,
) -> ValueAscent:
    """Reserve the memory for gradients of the mean of Q1(s, pi(s)) with respect to the parameters of E controllers.

    Args:
        controllers: (E, P) float32, read in place.
        controller_shape: Layers of each controller.
        critics: (E, P_critic) float32, the critic of each controller; read in place.
        critic_shape: Layers of each critic.
        rows: N, states per batch.
        weight: Weight of each state in the mean; None for 1/N.
    """
    obs_dim, act_dim = controller_shape.sizes[0], controller_shape.sizes[-1]
    judges = make_batched_mlp(critic_shape, critics, rows, tanh=False)
    inputs = controllers.new_zeros((len(controllers), rows, critic_shape.sizes[0]))
    states, actions = inputs.split([obs_dim, act_dim], dim=2)
    return ValueAscent(
        controllers=make_batched_mlp(controller_shape, controllers, rows, tanh=True),
        critics=judges,
        inputs=inputs,
        states=states,
        actions=actions,
        action_weights=judges.weights[0][:, :, obs_dim:],
        # A product with so few columns is several times as fast if it writes them as rows.
        by_action=controllers.new_zeros((len(controllers), act_dim, rows)).transpose(1, 2),
        weights=controllers.new_full((1, rows, 1), 1.0 / rows if weight is None else weight),
    )


@compiled
def climb(ascent: ValueAscent, states: Tensor) -> None:
    """Fill the controllers' gradient for states (E or 1, N, obs_dim)."""
    ascent.states.copy_(states)
    ascent.actions.copy_(forward(ascent.controllers, states))
    forward(ascent.critics, ascent.inputs)
    input_gradient(ascent.critics, ascent.weights, ascent.action_weights, ascent.by_action)
    backward(ascent.controllers, states, ascent.by_action)


@compiled
def climb_on(ascent: ValueAscent, adam: Adam, batches: list[Tensor], learning_rate: float) -> None:
    """Take one step up per batch of states (E or 1, N, obs_dim)."""
    for states in batches:
        climb(ascent, states)
        adam_step(adam, ascent.controllers.gradient, learning_rate, maximize=True)
