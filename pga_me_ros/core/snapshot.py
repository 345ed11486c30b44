"""What the offspring of one generation need of what was learned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.policy import MlpShape


@dataclass(frozen=True)
class Snapshot:
    """What was learned, for one generation's offspring; light, so that any node can hold it.

    Where a system learns no critics, the fields that speak of them are empty, the values NaN.

    Attributes:
        generation: Generation whose offspring it is for.
        version: Critic training steps done since the start of the run.
        critic_shape: Layers of the first critic; its input is the observation, then the action. None without one.
        critic: (P_critic,) float32 parameters of Q_theta1.
        greedy_shape: Layers of the greedy controller.
        greedy: (P,) float32 parameters of pi_phic.
        states: (sets, n_grad, N, observation_dim) float32 replay states; one set shared by all offspring, or one per
            place in the batch.
        transitions: Transitions in the replay buffer that it was trained on.
        critic_loss: Mean over the steps of both critics' mean squared errors.
        mean_q: Mean over the steps of the values that the first critic gave their batches.
        center: (P,) float32 controller that the samples of an evolution strategy surround; None where there is none.
        diversity_critic: (P_critic,) float32 parameters of the first diversity critic, with the layers of `critic`;
            None unless the system is `qd_rl`.
    """

    generation: int
    version: int
    critic_shape: MlpShape | None
    critic: NDArray[np.float32]
    greedy_shape: MlpShape
    greedy: NDArray[np.float32]
    states: NDArray[np.float32]
    transitions: int
    critic_loss: float
    mean_q: float
    center: NDArray[np.float32] | None = None
    diversity_critic: NDArray[np.float32] | None = None
