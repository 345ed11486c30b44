"""QD-RL (Cideron et al. 2020) with a MAP-Elites archive, a baseline of section 4.2.

docs/algorithms.md lists our choices where the sources leave something open.
"""

from __future__ import annotations

from collections.abc import Mapping

from pga_me_ros.arrays import Int64Array
from pga_me_ros.core.algorithms.algorithm import Algorithm, Slots
from pga_me_ros.core.algorithms.qd_rl.selection import pareto_parents
from pga_me_ros.core.algorithms.qd_rl.state_descriptors import require_step_descriptor
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.networks.shapes import critic_shape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import DIVERSITY_CRITIC
from pga_me_ros.errors import RequestError
from pga_me_ros.tasks.spec import TaskSpec


class QdRl(Algorithm):
    """PG offspring of elites on the Pareto fronts: half climb the quality critic, half the diversity critic."""

    name = "qd_rl"
    title = "QD-RL"
    operators = (Operator.QUALITY, Operator.DIVERSITY)

    def check_task(self, spec: TaskSpec) -> None:
        """Refuse a task without state descriptors."""
        require_step_descriptor(spec)

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Half of the batch for quality, half for diversity; quality gets the odd one."""
        b = settings.batch_size
        n_quality = (b + 1) // 2
        return [
            Slots(Operator.QUALITY, 0, n_quality),
            Slots(Operator.DIVERSITY, n_quality, b - n_quality),
        ]

    def uses_critics(self, settings: Settings) -> bool:
        """Always."""
        return True

    def snapshot_networks(self, spec: TaskSpec, settings: Settings) -> Mapping[str, MlpShape]:
        """Return the shapes of the networks, the first diversity critic included."""
        networks = super().snapshot_networks(spec, settings)
        return {**networks, DIVERSITY_CRITIC: critic_shape(spec, settings)}

    def choose_parents(
        self,
        archive: Archive,
        settings: Settings,
        generation: int,
        first: int,
        count: int,
        each: int,
    ) -> Int64Array:
        """Take parents from the Pareto fronts of fitness and novelty, see `pareto_parents`.

        The parents of a whole generation are chosen at once, so any division of a batch draws the same parents.

        Raises:
            ArchiveError: The archive is empty.
            RequestError: `each` is not 1, or a place is beyond the batch.
        """
        b = settings.batch_size - settings.extracted
        if each != 1 or first + count > b:
            raise RequestError(
                f"{each} parents each were requested for places {first} to {first + count - 1}; in {self.name}, "
                f"places 0 to {b - 1} have one parent each."
            )
        rng = generator(settings.seed, Purpose.QDRL_SELECTION, generation)
        cells = pareto_parents(archive, settings.novelty_neighbors, rng, b)
        return cells[first : first + count, None]
