"""Settings of evaluating elites again within the loop: Extract-MAP-Elites (Flageat et al. 2025)."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.settings.departures import DepartureSettings
from pga_me_ros.core.settings.field import setting


@dataclass(frozen=True)
class ExtractionSettings(DepartureSettings):
    """How much of a batch goes to elites that are in the archive already, and how many solutions a cell holds."""

    extract_share: float = setting(
        0.0,
        "Share of each batch that evaluates solutions again which are taken out of the archive for it "
        "(Extract-MAP-Elites); 0: none, the algorithm as published.",
        low=0.0,
        high=0.9,
        part="extraction",
    )
    cell_depth: int = setting(
        1,
        "Solutions that a cell holds, so that the next best returns when a lucky one is unmasked; more than 1 needs "
        "extract_share.",
        low=1,
        high=64,
        unit="solutions",
        part="extraction",
    )

    @property
    def extracted(self) -> int:
        """Solutions of each batch, after the random ones, that are taken out of the archive."""
        return round(self.extract_share * self.batch_size)
