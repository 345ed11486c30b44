"""The settings of a run: the one source of names, defaults, ranges, units and documentation.

ROS parameter descriptors, the validation of YAML files and the table in the docs are derived from `Settings`.
Defaults are Table 1 of Nilsson & Cully (2021); where the authors' code departs from the paper, a setting chooses and
its description names both.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from pga_me_ros.core.errors import SettingsError, nearest_name
from pga_me_ros.core.setting_field import checked_value, setting

INT64_MAX = 2**63 - 1


@dataclass(frozen=True)
class Settings:
    """Everything that decides which repertoire a run ends with."""

    task: str = setting(
        "qd_walker", "Simulated robot: a built-in task, or module.path:ClassName for one's own."
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
        "Controllers evaluated per generation.",
        low=2,
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

    n_evo: int = setting(
        50,
        "Offspring per generation by genetic variation; batch_size makes it standard MAP-Elites, 0 PG only.",
        low=0,
        high=100_000,
        unit="offspring",
        symbol="n_evo",
        rate=True,
    )
    iso_sigma: float = setting(
        0.005,
        "Standard deviation of the isotropic noise of genetic variation (Eq. 6).",
        low=0.0,
        high=100.0,
        symbol="sigma_1",
        rate=True,
    )
    line_sigma: float = setting(
        0.05,
        "Standard deviation of the step along the line between two parents (Eq. 6).",
        low=0.0,
        high=100.0,
        symbol="sigma_2",
        rate=True,
    )
    n_grad: int = setting(
        10,
        "Policy gradient steps per offspring.",
        low=1,
        high=10_000,
        unit="steps",
        symbol="n_grad",
        rate=True,
    )
    pg_learning_rate: float = setting(
        0.001, "Adam learning rate of policy gradient variation.", low=0.0, high=10.0, rate=True
    )
    n_crit: int = setting(
        300,
        "Critic training steps per generation.",
        low=1,
        high=1_000_000,
        unit="steps",
        symbol="n_crit",
        rate=True,
    )
    critic_learning_rate: float = setting(
        3e-4, "Adam learning rate of the critics.", low=0.0, high=10.0, rate=True
    )
    greedy_learning_rate: float = setting(
        3e-4, "Adam learning rate of the greedy controller.", low=0.0, high=10.0, rate=True
    )
    discount: float = setting(
        0.99, "Discount factor.", low=0.0, high=1.0, symbol="gamma", rate=True
    )
    target_rate: float = setting(
        0.005,
        "Share of the networks that moves into their targets (Eq. 4).",
        low=0.0,
        high=1.0,
        symbol="tau",
        rate=True,
    )
    smoothing_sigma: float = setting(
        0.2,
        "Standard deviation of the smoothing noise on target actions.",
        low=0.0,
        high=10.0,
        symbol="sigma_p",
        rate=True,
    )
    smoothing_clip: float = setting(
        0.5, "Greatest magnitude of the smoothing noise.", low=0.0, high=10.0, symbol="c", rate=True
    )
    target_period: int = setting(
        2,
        "Critic steps per update of the greedy controller and the targets.",
        low=1,
        high=1_000_000,
        unit="steps",
        symbol="d",
        rate=True,
    )

    transition_batch: int = setting(
        256,
        "Transitions per training batch.",
        low=1,
        high=1_000_000,
        unit="transitions",
        symbol="N",
    )
    replay_size: int = setting(
        1_000_000,
        "Transitions that the replay buffer holds, first in first out.",
        low=1,
        high=100_000_000,
        unit="transitions",
    )

    schedule: str = setting(
        "overlapped",
        "'overlapped': the critics train on the experience up to generation t-1 while t is evaluated (as coded); "
        "'alternating': they train on t before t+1 is made (Alg. 3 literally).",
        choices=("overlapped", "alternating"),
    )
    critic_start: str = setting(
        "after_init",
        "'after_init': training starts after the random controllers (paper, section 3.1); "
        "'last_init_batch': while the last batch of them is evaluated (as coded).",
        choices=("after_init", "last_init_batch"),
    )
    greedy_init: str = setting(
        "random",
        "Greedy controller at the start: 'random' (Alg. 3), or 'best', a copy of the fittest so far (as coded).",
        choices=("random", "best"),
    )
    greedy_takes: str = setting(
        "pg",
        "Whose place the greedy controller takes: 'pg' leaves n_evo GA and b-1-n_evo PG offspring (Alg. 5), "
        "'ga' leaves n_evo-1 and b-n_evo (as coded).",
        choices=("pg", "ga"),
    )
    line_noise: str = setting(
        "scalar",
        "Draws for the line of Eq. 6: 'scalar' is one per offspring (paper), 'tensor' one per tensor (as coded).",
        choices=("scalar", "tensor"),
    )
    pg_batches: str = setting(
        "shared",
        "Replay batches of PG variation: 'shared' by all offspring of a generation (as coded), or "
        "'own', drawn for each offspring (Alg. 5).",
        choices=("shared", "own"),
    )
    terminal: str = setting(
        "mask",
        "Value after a fall: 'mask' takes 0 (as coded), 'bootstrap' applies Eq. 5 to every transition.",
        choices=("mask", "bootstrap"),
    )
    target_action: str = setting(
        "clip",
        "Noisy target actions: 'clip' keeps them within the action limits (as coded), 'free' applies Eq. 5 literally.",
        choices=("clip", "free"),
    )
    torch_threads: int = setting(
        1,
        "Threads of a gradient computation; the order of sums, and with it the result, depends on it.",
        low=1,
        high=1024,
        unit="threads",
    )
    device: str = setting(
        "cpu",
        "Where gradients are computed: 'cpu', 'cuda', or 'auto', which takes a GPU if torch finds one; "
        "the last bits of the result depend on it.",
        choices=("cpu", "cuda", "auto"),
    )

    def __post_init__(self) -> None:
        """Check every value.

        Raises:
            SettingsError: A value has the wrong type or is out of its range.
        """
        for f in fields(self):
            object.__setattr__(self, f.name, checked_value(f, getattr(self, f.name)))
        if self.n_evo > self.batch_size:
            raise SettingsError(
                f"n_evo is {self.n_evo}, but a batch has batch_size={self.batch_size} controllers; "
                f"give n_evo a value from 0 to {self.batch_size}."
            )

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Settings:
        """Make settings from names and values, defaults for the rest.

        Raises:
            SettingsError: A name is unknown, or a value has the wrong type or is out of its range.
        """
        known = [f.name for f in fields(cls)]
        for name in values:
            if name not in known:
                raise SettingsError(
                    f"Unknown setting '{name}'{nearest_name(name, known)}; "
                    "docs/parameters.md lists all."
                )
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """Return names and values, tuples as lists, fit for JSON."""
        return {
            k: list(v) if isinstance(v, tuple) else v for k, v in dataclasses.asdict(self).items()
        }

    def replace(self, **changes: Any) -> Settings:
        """Return a copy with some values changed and checked."""
        return dataclasses.replace(self, **changes)

    @property
    def init_generations(self) -> int:
        """Number of generations of random controllers: ceil(G / b)."""
        return math.ceil(self.random_init / self.batch_size)

    @property
    def generations(self) -> int:
        """Number of generations that reach the budget: ceil(I / b)."""
        return math.ceil(self.evaluations / self.batch_size)


RATES = tuple(f.name for f in fields(Settings) if f.metadata["rate"])
"""Names of the settings that may change while a run is under way."""


def identity_difference(ours: Settings, theirs: Settings) -> list[str]:
    """Name the settings in which two runs differ, other than rates and the budget.

    Returns:
        One ``"name: ours != theirs"`` per difference, empty when one may resume the other.
    """
    out = []
    for f in fields(Settings):
        if f.metadata["identity"] and not f.metadata["rate"]:
            a, b = getattr(ours, f.name), getattr(theirs, f.name)
            if a != b:
                out.append(f"{f.name}: {a} != {b}")
    return out
