"""The settings of a run: names, defaults, ranges, units and documentation in one place."""

from __future__ import annotations

from pga_me_ros.core.settings.settings import RATES, Settings, identity_difference

__all__ = ["RATES", "Settings", "identity_difference"]
