"""Settings that one of the systems of section 4.2 has to itself; the others pass them over."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.departure_settings import DepartureSettings
from pga_me_ros.core.setting_field import setting


@dataclass(frozen=True)
class SystemSettings(DepartureSettings):
    """What only a single system asks for; each description begins with its name."""

    exploration_sigma: float = setting(
        0.1,
        "td3: standard deviation of the Gaussian noise on the actor's actions, which are then clipped to their limits.",
        low=0.0,
        high=10.0,
        symbol="sigma_a",
    )
