"""What was learned, as far as one generation's offspring need it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.errors import RequestError

Network = tuple[MlpShape, Float32Array]
"""Layers of a network, and its (P,) float32 parameters."""

CRITIC = "critic"
"""The first critic, Q_theta1; its input is the observation, then the action."""

GREEDY = "greedy"
"""The greedy controller, pi_phic; in MAP-Elites-ES, the controller that the last step led to."""

ACTOR = "actor"
"""DCRL-MAP-Elites: the actor, pi_phi(s | d); its input is the observation, then a descriptor scaled to -1..1. There,
`CRITIC` takes the same before the action."""

CENTER = "center"
"""MAP-Elites-ES: the controller around which samples are drawn."""

DIVERSITY_CRITIC = "diversity_critic"
"""QD-RL: the first critic of diversity; its input is that of `CRITIC`."""


@dataclass(frozen=True)
class Snapshot:
    """What was learned, for one generation's offspring; light, so that any node can hold it.

    If an algorithm learns no critics, there are no states, and `critic_loss` and `mean_q` are NaN.

    Attributes:
        generation: Generation of the offspring.
        version: Critic training steps done since the start of the run.
        networks: Networks by name; `Algorithm.snapshot_networks` says which there are.
        states: (sets, n_grad, N, observation_dim) float32 replay states; one set shared by all offspring, or one per
            place in the batch.
        transitions: Number of transitions in the replay buffer during the training.
        critic_loss: Mean over the steps of both critics' mean squared errors.
        mean_q: Mean over the steps of the first critic's mean value of a batch.
    """

    generation: int
    version: int
    networks: Mapping[str, Network]
    states: Float32Array
    transitions: int
    critic_loss: float
    mean_q: float

    def network(self, name: str) -> Network:
        """Return the layers and the (P,) float32 parameters of a network.

        Raises:
            RequestError: There is no network of that name.
        """
        try:
            return self.networks[name]
        except KeyError:
            raise RequestError(
                f"The snapshot of generation {self.generation} has no network '{name}', only {sorted(self.networks)}; "
                "give one that was learned by the algorithm of this run."
            ) from None

    def parameters(self, name: str) -> Float32Array:
        """Return the (P,) float32 parameters of a network.

        Raises:
            RequestError: There is no network of that name.
        """
        return self.network(name)[1]
