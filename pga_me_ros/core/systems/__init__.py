"""The systems that section 4.2 of Nilsson & Cully (2021) compares, by the value of the setting `algorithm`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pga_me_ros.core.systems.map_elites import MapElites
from pga_me_ros.core.systems.map_elites_es import MapElitesEs
from pga_me_ros.core.systems.pg_only import PgOnly
from pga_me_ros.core.systems.pga_map_elites import PgaMapElites
from pga_me_ros.core.systems.qd_rl import QdRl
from pga_me_ros.core.systems.system import Slots, System
from pga_me_ros.core.systems.td3 import Td3

if TYPE_CHECKING:
    from pga_me_ros.core.settings import Settings

__all__ = ["SYSTEMS", "Slots", "System", "system_of"]

SYSTEMS: dict[str, System] = {
    system.name: system
    for system in (PgaMapElites(), MapElites(), PgOnly(), Td3(), MapElitesEs(), QdRl())
}
"""All of them, PGA-MAP-Elites first."""


def system_of(settings: Settings) -> System:
    """Return the system that settings name."""
    return SYSTEMS[settings.algorithm]
