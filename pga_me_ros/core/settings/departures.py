"""Settings that choose where the authors' code departs from the paper, and where gradients are computed."""

from __future__ import annotations

from dataclasses import dataclass

from pga_me_ros.core.settings.field import setting
from pga_me_ros.core.settings.learning import LearningSettings


@dataclass(frozen=True)
class DepartureSettings(LearningSettings):
    """The paper or its authors' program, and what the last bits of a result depend on."""

    schedule: str = setting(
        "",
        "'overlapped': the critics train on the experience up to generation t-1 while t is evaluated (as coded); "
        "'alternating': they train on t before t+1 is made (Alg. 3 literally); empty: the algorithm's own.",
        choices=("", "overlapped", "alternating"),
        own=True,
        part="critics",
    )
    critic_start: str = setting(
        "after_init",
        "'after_init': training starts after the random controllers (paper, section 3.1); "
        "'last_init_batch': while the last batch of them is evaluated (as coded).",
        choices=("after_init", "last_init_batch"),
        part="critics",
    )
    greedy_init: str = setting(
        "random",
        "Greedy controller at the start: 'random' (Alg. 3), or 'best', a copy of the fittest so far (as coded).",
        choices=("random", "best"),
        part="critics",
    )
    greedy_takes: str = setting(
        "pg",
        "Whose place the greedy controller takes: 'pg' leaves n_evo GA and b-1-n_evo PG offspring (Alg. 5), "
        "'ga' leaves n_evo-1 and b-n_evo (as coded).",
        choices=("pg", "ga"),
        part="pga_map_elites",
    )
    line_noise: str = setting(
        "scalar",
        "Draws for the line of Eq. 6: 'scalar' is one per offspring (paper), 'tensor' one per tensor (as coded).",
        choices=("scalar", "tensor"),
        part="genetic",
    )
    pg_batches: str = setting(
        "shared",
        "Replay batches of PG variation: 'shared' by all offspring of a generation (as coded), or "
        "'own', drawn for each offspring (Alg. 5).",
        choices=("shared", "own"),
        part="gradients",
    )
    terminal: str = setting(
        "mask",
        "Value after a fall: 'mask' takes 0 (as coded), 'bootstrap' applies Eq. 5 to every transition.",
        choices=("mask", "bootstrap"),
        part="critics",
    )
    target_action: str = setting(
        "clip",
        "Noisy target actions: 'clip' keeps them within the action limits (as coded), 'free' applies Eq. 5 literally.",
        choices=("clip", "free"),
        part="critics",
    )
    torch_threads: int = setting(
        1,
        "Threads of a gradient computation; the order of sums, and with it the result, depends on it.",
        low=1,
        high=1024,
        unit="threads",
        part="torch",
    )
    device: str = setting(
        "cpu",
        "Where gradients are computed: 'cpu', 'cuda', or 'auto', which takes a GPU if torch finds one; "
        "the last bits of the result depend on it.",
        choices=("cpu", "cuda", "auto"),
        part="torch",
    )
