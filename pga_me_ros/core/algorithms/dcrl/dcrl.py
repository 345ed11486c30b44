"""DCRL-MAP-Elites (Faldor, Chalumeau, Flageat & Cully, ACM TELO 2025), the successor of PGA-MAP-Elites.

docs/algorithms.md lists our choices where the paper leaves something open.
"""

from __future__ import annotations

from collections.abc import Mapping

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.algorithms.algorithm import Slots
from pga_me_ros.core.algorithms.pga_map_elites import PgaMapElites
from pga_me_ros.core.networks.conditioned import ConditionedDimensions
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.networks.shapes import controller_shape, critic_shape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import ACTOR, CRITIC
from pga_me_ros.tasks.spec import TaskSpec


class DcrlMapElites(PgaMapElites):
    """GA offspring, then the actor conditioned on elites' descriptors, then PG offspring that keep their parent's.

    There is no greedy controller: one actor pi(s | d) takes its place, evaluated by critics Q(s, a | d).
    """

    name = "dcrl_map_elites"
    title = "DCRL-MAP-Elites"
    operators = (Operator.GA, Operator.ACTOR_INJECTION, Operator.PG)
    conditioned = True

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Half of the batch by GA, a quarter by actor injection, a quarter by PG, unless settings say otherwise.

        Injected actors take no time to make, so they come before PG offspring: their evaluation can start at once.
        """
        b, n_ga = settings.batch_size, settings.n_evo
        n_injected = int((b - n_ga) * settings.injection_share)
        return [
            Slots(Operator.GA, 0, n_ga),
            Slots(Operator.ACTOR_INJECTION, n_ga, n_injected),
            Slots(Operator.PG, n_ga + n_injected, b - n_ga - n_injected),
        ]

    def snapshot_networks(self, spec: TaskSpec, settings: Settings) -> Mapping[str, MlpShape]:
        """Return the shapes of the first critic and of the actor, which take a descriptor besides the observation."""
        seen = ConditionedDimensions.of(spec)
        return {CRITIC: critic_shape(seen, settings), ACTOR: controller_shape(seen, settings)}

    def intended(self, operator: Operator, parents: Float64Array) -> Float64Array | None:
        """PG offspring are meant to keep their parent's descriptor, the actor to reach the one it is conditioned on."""
        return None if operator not in (Operator.ACTOR_INJECTION, Operator.PG) else parents[:, 0]
