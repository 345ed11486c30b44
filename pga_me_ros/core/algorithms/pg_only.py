"""PGA-MAP-Elites with policy gradient variation alone: n_evo = 0 in Alg. 5 (section 4.2)."""

from __future__ import annotations

from pga_me_ros.core.algorithms.pga_map_elites import PgaMapElites
from pga_me_ros.core.operators import Operator


class PgOnly(PgaMapElites):
    """The greedy controller and b - 1 PG offspring."""

    name = "pg_only"
    title = "PGA-MAP-Elites (only PG)"
    operators = (Operator.GREEDY, Operator.PG)
