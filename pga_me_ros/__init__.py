"""PGA-MAP-Elites as a ROS 2 node graph, and as a library.

Grows a repertoire of neural-network gaits that differ in how they use the robot's feet (Nilsson &
Cully 2021, "Policy Gradient Assisted MAP-Elites"), and offers it to other nodes.

The names below are loaded on first use: ``import pga_me_ros`` itself loads nothing but the standard library.
`pga_me_ros.client` has what another robot's node needs.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from pga_me_ros.dependencies import report_missing_dependencies
from pga_me_ros.process.collection import pause_collection
from pga_me_ros.process.early_signals import end_on_early_signals, own_program

if TYPE_CHECKING:
    from pga_me_ros.core.adaptation.adaptation import Adaptation
    from pga_me_ros.core.adaptation.adaptation_settings import AdaptationSettings
    from pga_me_ros.core.adaptation.performance_map import PerformanceMap
    from pga_me_ros.core.algorithms import ALGORITHMS
    from pga_me_ros.core.search import Search
    from pga_me_ros.core.settings import Settings
    from pga_me_ros.library import StoredRun, save_run
    from pga_me_ros.tasks.registry import load_task, make_task

__version__ = "0.1.0"

__all__ = [
    "ALGORITHMS",
    "Adaptation",
    "AdaptationSettings",
    "PerformanceMap",
    "Search",
    "Settings",
    "StoredRun",
    "load_task",
    "make_task",
    "save_run",
]

_MODULES = {
    "ALGORITHMS": "core.algorithms",
    "Adaptation": "core.adaptation.adaptation",
    "AdaptationSettings": "core.adaptation.adaptation_settings",
    "PerformanceMap": "core.adaptation.performance_map",
    "Search": "core.search",
    "Settings": "core.settings",
    "StoredRun": "library",
    "load_task": "tasks.registry",
    "make_task": "tasks.registry",
    "save_run": "library",
}


if _program := own_program():
    end_on_early_signals(_program)
    if _program.startswith("nodes."):
        pause_collection()
    report_missing_dependencies()


def __getattr__(name: str) -> Any:
    """Load a public name (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    return getattr(importlib.import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
