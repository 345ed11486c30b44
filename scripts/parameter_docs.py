"""Print docs/parameters.md: ``python scripts/parameter_docs.py > docs/parameters.md``."""

from __future__ import annotations

from pga_me_ros.core.settings import Settings
from pga_me_ros.nodes.archive_manager import ArchiveManagerSettings
from pga_me_ros.nodes.evaluator import EvaluatorSettings
from pga_me_ros.nodes.options import ChildOptions, RunOptions
from pga_me_ros.player.settings import PlayerSettings
from pga_me_ros.recording.settings import RecorderSettings
from pga_me_ros.ros.parameter_help import parameter_table

PAGE = """\
# Parameters

<!-- Made by scripts/parameter_docs.py from the dataclasses that the nodes declare; edit those. -->

`--help` of every executable prints the same, without starting ROS 2. Parameters are given on the command line,
`--ros-args -p n_evo:=80`, or in a YAML file, `--ros-args --params-file config/qd_walker.yaml`:

    /**:
      ros__parameters:
        task: qd_walker
        evaluations: 20000

- What stands later on the command line counts, so `-p` goes after `--params-file`. Keep to one section, `/**`, per
  file: with several, ROS 2 goes by the order in which it met their names, and a `-p` may lose to the file.
- One file serves all nodes: each takes what it knows and passes over what belongs to another. A name that none knows,
  a value of the wrong type or out of its range ends the node with one line and exit code 2.
- Whole numbers may be written as `1e6`, and numbers with a fraction without one, as `1`.
- Parameters with "yes" under "set while running" are rates: `ros2 param set /orchestrator n_evo 80` takes effect with
  the next generation and is recorded with it. The others are read-only.
- A run goes on with the command that started it. The budget `evaluations` may change, and so may the rates: a start
  that names other rates than the run's first start puts those in force, any other keeps those last set. All other
  settings of the run are its identity, and a run directory refuses others.

Beside ROS 2's own environment variables there is one default: where neither `ROS_AUTOMATIC_DISCOVERY_RANGE` nor
`ROS_LOCALHOST_ONLY` is set, every executable takes `ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`, for itself and for what
it starts. For several machines, export `SUBNET` on each. With `ROS_SECURITY_ENABLE=true` nothing starts where ROS 2
comes from wheels, which have no DDS security ([security.md](security.md)).

## The run: orchestrator

{settings}
## How the run is carried out: orchestrator

{run}
## evaluator

{evaluator}
## archive_manager

{archive}
## behavior_player

{player}
## record

{recorder}
## critic_trainer, variation

Started by the orchestrator, with the settings of the run and:

{child}"""


def page() -> str:
    """Return the page in Markdown."""
    return PAGE.format(
        settings=parameter_table(Settings),
        run=parameter_table(RunOptions),
        evaluator=parameter_table(EvaluatorSettings),
        archive=parameter_table(ArchiveManagerSettings),
        player=parameter_table(PlayerSettings),
        recorder=parameter_table(RecorderSettings),
        child=parameter_table(ChildOptions),
    )


if __name__ == "__main__":
    print(page(), end="")
