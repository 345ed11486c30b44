"""TD3 (Fujimoto et al. 2018; Alg. 2 of Nilsson & Cully 2021), with an archive that collects behaviors passively."""

from __future__ import annotations

from pga_me_ros.core.algorithms.algorithm import Algorithm, Slots
from pga_me_ros.core.exploration import QUIET, Noise
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings


class Td3(Algorithm):
    """One actor, the greedy controller: it acts with exploration noise and learns from its own experience.

    A generation is b episodes of the current actor; afterwards it takes one training step per environment step.
    """

    name = "td3"
    title = "TD3"
    operators = (Operator.GREEDY,)

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Alg. 2 line 7: the actor, in every place."""
        return [Slots(Operator.GREEDY, 0, settings.batch_size)]

    def uses_critics(self, settings: Settings) -> bool:
        """Always."""
        return True

    def exploration(self, settings: Settings, generation: int) -> Noise:
        """Alg. 2 line 7; the random controllers at the start explore by themselves."""
        if generation < settings.init_generations:
            return QUIET
        return Noise(settings.exploration_sigma, settings.exploration_correlation)
