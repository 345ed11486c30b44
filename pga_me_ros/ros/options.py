"""Parameters that decide how a run is carried out but not what it finds: they are not part of its identity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pga_me_ros.core.settings.field import setting
from pga_me_ros.core.storage.reevaluations import MOST_REPEATS
from pga_me_ros.errors import SettingsError

LISTEN = 4.0
"""Seconds within which a living namesake is heard. Two nodes usually find each other at once, but now and then one's
announcement comes too early for the other, and Fast DDS repeats it after up to 3 s. Then comes the next heartbeat, one
every second."""


@dataclass(frozen=True)
class ChildOptions:
    """What the orchestrator tells each node that it starts for a run."""

    run_id: str = setting("", "Run that the node works for.")
    run_dir: str = setting("", "Folder of the run.", path=True)


def require_run(options: Mapping[str, Any], node: str) -> str:
    """Return the id of the run that a node was started for.

    Args:
        options: Values of `ChildOptions`.
        node: Executable.

    Raises:
        SettingsError: There is none. A node without a run would intercept the requests of other runs and refuse them.
    """
    if not options["run_id"]:
        raise SettingsError(
            f"No run_id is given: {node} works for one run, and the run's orchestrator starts it. "
            "Start an orchestrator instead."
        )
    return str(options["run_id"])


@dataclass(frozen=True)
class RunOptions:
    """Parameters of the orchestrator besides the settings of the run."""

    run_dir: str = setting(
        "",
        "Folder of the run; a run that it holds is resumed. Empty for runs/TASK-seedSEED, with the algorithm before "
        "the seed if it is not pga_map_elites.",
        path=True,
    )
    evaluators: int = setting(
        0,
        "Evaluators to start on this machine; 0 starts one per core. Others may join from any machine.",
        low=0,
        high=1024,
        unit="processes",
    )
    min_evaluators: int = setting(
        1, "Evaluators that must be there before work starts.", low=1, high=1024, unit="processes"
    )
    discovery_wait: float = setting(
        LISTEN,
        "How long to listen for another orchestrator of this name and its nodes before the run starts. Set 0 to start "
        "at once in a domain that nobody else uses, and more where discovery is slow.",
        low=0.0,
        high=600.0,
        unit="s",
    )
    reevaluations: int = setting(
        5,
        "Evaluations of each elite from other initial poses once the budget is reached; 0 for none. They tell what a "
        "behavior is worth on average, and count apart from the budget.",
        low=0,
        high=MOST_REPEATS,
        unit="evaluations per elite",
    )
    tensorboard: bool = setting(
        False,
        "Whether to write the metrics of each generation as TensorBoard events, too, next to metrics.csv. Needs "
        "the Python package tensorboard.",
    )
    serve: bool = setting(
        True, "Whether to keep serving the finished repertoire until stopped, or to exit."
    )
