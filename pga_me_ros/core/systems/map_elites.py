"""Standard MAP-Elites with directional variation (Vassiliades & Mouret 2018), as section 4.2 compares with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from pga_me_ros.core.elites import Operator
from pga_me_ros.core.errors import SettingsError
from pga_me_ros.core.systems.system import Slots, System

if TYPE_CHECKING:
    from pga_me_ros.core.settings import Settings


class MapElites(System):
    """All offspring by genetic variation, no critics: PGA-MAP-Elites with n_evo = b."""

    name = "map_elites"
    title = "MAP-Elites"
    parents: ClassVar[Mapping[Operator, int]] = {Operator.GA: 2}

    def check(self, settings: Settings, given: Mapping[str, Any]) -> None:
        """Also refuse to leave places to gradients."""
        super().check(settings, given)
        b = settings.batch_size
        if given.get("n_evo", b) != b:
            raise SettingsError(
                f"n_evo is {settings.n_evo}, but {self.name} makes all {b} offspring of a generation by genetic "
                "variation; leave n_evo out."
            )

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Alg. 5 with n_evo = b (section 4.2)."""
        return [Slots(Operator.GA, 0, settings.batch_size)]
