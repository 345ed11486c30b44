"""Settings of a run as a whole: what it grows, from what, for how long, in which layers."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.setting_field import INT64_MAX, setting
from pga_me_ros.core.systems import SYSTEMS


@dataclass(frozen=True)
class RunSettings:
    """Task, system, budget, archive and networks."""

    task: str = setting(
        "qd_walker", "Simulated robot: a built-in task, or module.path:ClassName for one's own."
    )
    algorithm: str = setting(
        "pga_map_elites",
        "System of section 4.2: PGA-MAP-Elites or one that it is compared with; docs/algorithms.md tells of each.",
        choices=tuple(SYSTEMS),
    )
    seed: int = setting(0, "Seed of every random draw of the run.", low=0, high=INT64_MAX)
    evaluations: int = setting(
        1_000_000,
        "Budget: the run ends with the generation that reaches it; a later start may raise it.",
        low=1,
        high=INT64_MAX,
        unit="evaluations",
        symbol="I",
        identity=False,
    )
    random_init: int = setting(
        500,
        "Random controllers before variation starts, in whole batches.",
        low=1,
        high=10_000_000,
        unit="controllers",
        symbol="G",
    )
    start_from: str = setting(
        "",
        "Run or exported .npz file whose controllers are evaluated first, in place of random ones; empty for none.",
    )
    batch_size: int = setting(
        100,
        "Controllers evaluated per generation; td3 reads this default as its own, 10.",
        low=1,
        high=100_000,
        unit="controllers",
        symbol="b",
    )

    archive: str = setting(
        "cvt",
        "Cells: 'cvt' is a centroidal Voronoi tessellation (as coded by the authors), "
        "'grid' has equal bins per dimension (as the paper words it).",
        choices=("cvt", "grid"),
    )
    cells: int = setting(
        0,
        "Cells of a CVT archive, 0 for the task's own (Walker and Cheetah 1024, Ant 1296, Hopper 1000); "
        "a grid takes its bins from the task and passes this over.",
        low=0,
        high=1_000_000,
        unit="cells",
    )
    cvt_samples: int = setting(
        100_000,
        "Uniform samples that the Voronoi cells of a CVT archive are made of.",
        low=1,
        high=10_000_000,
        unit="samples",
    )

    controller_hidden: tuple[int, ...] = setting(
        (128, 128), "Neurons of the controllers' hidden layers.", low=1, high=65536, unit="neurons"
    )
    critic_hidden: tuple[int, ...] = setting(
        (256, 256), "Neurons of the critics' hidden layers.", low=1, high=65536, unit="neurons"
    )
