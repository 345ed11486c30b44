"""Settings of a run as a whole: what it grows, from what, for how long, in which layers."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.settings.field import INT64_MAX, setting

ARCHIVE_KINDS = ("cvt", "grid")
"""Values of `archive`; `core.archive.make_archive` makes them."""

ALGORITHM_NAMES = (
    "pga_map_elites",
    "map_elites",
    "pg_only",
    "td3",
    "map_elites_es",
    "qd_rl",
    "dcrl_map_elites",
)
"""Values of `algorithm`; `core.settings.rules` has the rules of each, `core.algorithms` the algorithms themselves."""


@dataclass(frozen=True)
class RunSettings:
    """Task, algorithm, budget, archive and networks."""

    task: str = setting(
        "qd_walker", "Simulated robot: a built-in task, or module.path:ClassName for one's own."
    )
    randomization: str = setting(
        "",
        "What varies between evaluations besides the initial pose, and within which limits, for example "
        "'mass 0.8 1.2, friction 0.5 1.0'; empty: nothing. docs/promises.md lists the kinds.",
    )
    algorithm: str = setting(
        "pga_map_elites",
        "PGA-MAP-Elites, an algorithm that it is compared with (section 4.2), or its successor DCRL-MAP-Elites; "
        "docs/algorithms.md describes each.",
        choices=ALGORITHM_NAMES,
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
        0,
        "Random controllers before variation starts, in whole batches; 0: the algorithm's own number.",
        low=0,
        high=10_000_000,
        own=True,
        unit="controllers",
        symbol="G",
    )
    start_from: str = setting(
        "",
        "Run or exported .npz file whose controllers are evaluated first, in place of random ones; several are "
        "separated by commas; empty for none.",
        path=True,
        several=True,
    )
    batch_size: int = setting(
        0,
        "Controllers evaluated per generation; 0: the algorithm's own number.",
        low=0,
        high=100_000,
        own=True,
        unit="controllers",
        symbol="b",
    )

    archive: str = setting(
        "cvt",
        "Cells: 'cvt' is a centroidal Voronoi tessellation (as coded by the authors), "
        "'grid' has equal bins per dimension (as the paper words it).",
        choices=ARCHIVE_KINDS,
    )
    cells: int = setting(
        0,
        "Cells of a CVT archive; 0: the task's own number (Walker and HalfCheetah 1024, Ant 1296, Hopper 1000). "
        "A grid takes its bins from the task.",
        low=0,
        high=1_000_000,
        unit="cells",
        part="cvt",
    )
    cvt_samples: int = setting(
        100_000,
        "Uniform samples that the cells of a CVT archive are computed from.",
        low=1,
        high=10_000_000,
        unit="samples",
        part="cvt",
    )

    controller_hidden: tuple[int, ...] = setting(
        (128, 128), "Neurons of the controllers' hidden layers.", low=1, high=65536, unit="neurons"
    )
    critic_hidden: tuple[int, ...] = setting(
        (256, 256),
        "Neurons of the critics' hidden layers.",
        low=1,
        high=65536,
        unit="neurons",
        part="critics",
    )
