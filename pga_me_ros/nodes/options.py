"""Parameters that say how a run is carried out, not what it finds: they are no part of its identity."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.setting_field import setting


@dataclass(frozen=True)
class ChildOptions:
    """What the orchestrator tells each node that it starts for a run."""

    run_id: str = setting("", "Run that the node works for.")
    run_dir: str = setting("", "Folder of the run.")


@dataclass(frozen=True)
class RunOptions:
    """Parameters of the orchestrator beside the settings of the run."""

    run_dir: str = setting(
        "", "Folder of the run, resumed when it holds one; empty takes runs/TASK-seedSEED."
    )
    evaluators: int = setting(
        0,
        "Evaluators to start on this machine; 0 starts one per core. Others may join from anywhere.",
        low=0,
        high=1024,
        unit="processes",
    )
    min_evaluators: int = setting(
        1, "Evaluators that must be there before work starts.", low=1, high=1024, unit="processes"
    )
    serve: bool = setting(
        True, "Whether to go on serving the finished repertoire until stopped, or to exit."
    )
