"""PGA-MAP-Elites with policy gradient variation alone: n_evo = 0 in Alg. 5 (section 4.2)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from pga_me_ros.core.elites import Operator
from pga_me_ros.core.errors import SettingsError
from pga_me_ros.core.systems.pga_map_elites import PgaMapElites

if TYPE_CHECKING:
    from pga_me_ros.core.settings import Settings


class PgOnly(PgaMapElites):
    """The greedy controller and b - 1 PG offspring."""

    name = "pg_only"
    title = "PGA-MAP-Elites (only PG)"
    defaults: ClassVar = {"n_evo": 0}
    parents: ClassVar[Mapping[Operator, int]] = {Operator.PG: 1}

    def check(self, settings: Settings, given: Mapping[str, Any]) -> None:
        """Also refuse genetic variation."""
        super().check(settings, given)
        if settings.n_evo:
            raise SettingsError(
                f"n_evo is {settings.n_evo}, but {self.name} makes no offspring by genetic variation; leave n_evo out."
            )
