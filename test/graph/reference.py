"""The expected result of a run: that of the same algorithm in this process, without nodes."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

from graph import TINY, tiny

from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.tasks.registry import make_task

ES = {
    "algorithm": "map_elites_es",
    "es_samples": 10,
    "batch_size": 11,
    "random_init": 1,
    "es_steps": 2,
}
"""Parameters of MAP-Elites-ES in addition to `TINY`; it alternates exploit and explore every second generation."""

NOT_SETTINGS = ("evaluators", "serve", "discovery_wait", "run_dir", "reevaluations")
"""Parameters of the orchestrator that do not affect the result."""


def search_digest(**parameters: Any) -> str:
    """Return the digest of the final archive of `core.search`; `parameters` are added to `TINY`."""
    return _searched(run_settings(**parameters))[0]


def search_metrics(**parameters: Any) -> list[Metrics]:
    """Return the metrics of every generation of such a search."""
    return _searched(run_settings(**parameters))[1]


def run_settings(**parameters: Any) -> Settings:
    """Return the settings of a run; `parameters` of the orchestrator are added to `TINY`."""
    values = tiny(**parameters)
    return Settings.from_mapping({n: v for n, v in values.items() if n not in NOT_SETTINGS})


@cache
def _searched(settings: Settings) -> tuple[str, list[Metrics]]:
    task = make_task(settings.task, settings.randomization)
    search = Search(task.spec, settings)
    try:
        while search.generation < settings.generations:
            search.run_generation(task)
    finally:
        task.close()
    return search.archive.digest(), search.metrics


def run_digest(run_dir: Path) -> str:
    """Return the digest of a run's committed result."""
    with Repertoire.open(run_dir / "repertoire.db", read_only=True) as repertoire:
        return repertoire.result_digest()


def evaluations_of(run_dir: Path) -> int:
    """Return the number of evaluations that a run has committed."""
    with Repertoire.open(run_dir / "repertoire.db", read_only=True) as repertoire:
        return TINY["batch_size"] * len(repertoire.metrics())
