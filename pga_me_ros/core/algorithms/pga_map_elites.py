"""PGA-MAP-Elites: Algorithms 3 to 5 of Nilsson & Cully (2021)."""

from __future__ import annotations

from typing import ClassVar

from pga_me_ros.core.algorithms.algorithm import Algorithm, Slots
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings


class PgaMapElites(Algorithm):
    """The greedy controller, then GA, then PG offspring.

    With n_evo = b there are no gradients and so no greedy controller: standard MAP-Elites.
    """

    name = "pga_map_elites"
    title = "PGA-MAP-Elites"
    operators: ClassVar[tuple[Operator, ...]] = (Operator.GREEDY, Operator.GA, Operator.PG)

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Alg. 3 lines 9-13, Alg. 5."""
        b = settings.batch_size
        if not self.uses_critics(settings):
            return [Slots(Operator.GA, 0, b)]
        taken = 1 if settings.greedy_takes == "ga" else 0
        n_ga = min(max(settings.n_evo - taken, 0), b - 1)
        return [
            Slots(Operator.GREEDY, 0, 1),
            Slots(Operator.GA, 1, n_ga),
            Slots(Operator.PG, 1 + n_ga, b - 1 - n_ga),
        ]

    def uses_critics(self, settings: Settings) -> bool:
        """Whether the rates in force leave part of the batch to gradients."""
        return settings.n_evo < settings.batch_size

    def trains_meanwhile(self, settings: Settings, generation: int) -> bool:
        """Asynchronous training (section 3.1), as soon as there is experience to train on."""
        first = settings.init_generations - (settings.critic_start == "last_init_batch")
        return (
            settings.schedule == "overlapped"
            and self.uses_critics(settings)
            and generation >= max(first, 1)
        )
