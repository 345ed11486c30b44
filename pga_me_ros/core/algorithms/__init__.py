"""The algorithms by the value of the setting `algorithm`: section 4.2 of Nilsson & Cully (2021), and a successor."""

from __future__ import annotations

from collections.abc import Mapping

from pga_me_ros.core.algorithms.algorithm import Algorithm, Slots
from pga_me_ros.core.algorithms.dcrl.dcrl import DcrlMapElites
from pga_me_ros.core.algorithms.map_elites import MapElites
from pga_me_ros.core.algorithms.map_elites_es.map_elites_es import MapElitesEs
from pga_me_ros.core.algorithms.pg_only import PgOnly
from pga_me_ros.core.algorithms.pga_map_elites import PgaMapElites
from pga_me_ros.core.algorithms.qd_rl.qd_rl import QdRl
from pga_me_ros.core.algorithms.td3.td3 import Td3
from pga_me_ros.core.settings import Settings

__all__ = ["ALGORITHMS", "Algorithm", "Slots", "algorithm_of"]

ALGORITHMS: Mapping[str, Algorithm] = {
    algorithm.name: algorithm
    for algorithm in (
        *(PgaMapElites(), MapElites(), PgOnly(), Td3(), MapElitesEs(), QdRl()),
        DcrlMapElites(),
    )
}
"""All algorithms, PGA-MAP-Elites first."""


def algorithm_of(settings: Settings) -> Algorithm:
    """Return the algorithm that the settings name."""
    return ALGORITHMS[settings.algorithm]
