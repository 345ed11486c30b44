"""Standard MAP-Elites with directional variation (Vassiliades & Mouret 2018), a baseline of section 4.2."""

from __future__ import annotations

from pga_me_ros.core.algorithms.algorithm import Algorithm, Slots
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings


class MapElites(Algorithm):
    """All offspring by genetic variation, no critics: PGA-MAP-Elites with n_evo = b."""

    name = "map_elites"
    title = "MAP-Elites"
    operators = (Operator.GA,)
    learns_critics = False

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Alg. 5 with n_evo = b (section 4.2)."""
        return [Slots(Operator.GA, 0, settings.batch_size)]
