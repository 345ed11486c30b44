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
    novelty_neighbors: int = setting(
        5,
        "qd_rl: nearest neighbours whose mean distance is the novelty of an elite, and of a state.",
        low=1,
        high=10_000,
        unit="neighbours",
        symbol="k",
    )
    state_archive_size: int = setting(
        10_000,
        "qd_rl: state descriptors that the novelty of a state is measured against, first in first out.",
        low=1,
        high=1_000_000,
        unit="descriptors",
    )
    state_spacing: float = setting(
        0.1,
        "qd_rl: distance, in shares of the descriptor's range, that a state descriptor must be away from all in that "
        "archive to enter it; 0 lets all enter.",
        low=0.0,
        high=1.0,
    )
