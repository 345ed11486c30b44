"""QD-RL (Cideron et al. 2020) with a MAP-Elites archive, as section 4.2 compares with.

docs/algorithms.md says what was chosen where the sources leave something open.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.elites import Operator
from pga_me_ros.core.errors import RequestError, SettingsError
from pga_me_ros.core.pareto_selection import pareto_parents
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.state_descriptors import require_step_descriptor
from pga_me_ros.core.systems.system import Slots, System

if TYPE_CHECKING:
    from pga_me_ros.core.archive import Archive
    from pga_me_ros.core.learner import Learner
    from pga_me_ros.core.settings import Settings
    from pga_me_ros.tasks.spec import TaskSpec


class QdRl(System):
    """Elites of the Pareto fronts climb, one half the critic of quality and the other that of diversity."""

    name = "qd_rl"
    title = "QD-RL"
    defaults: ClassVar[Mapping[str, Any]] = {"batch_size": 4, "schedule": "alternating"}
    parents: ClassVar[Mapping[Operator, int]] = {Operator.QUALITY: 1, Operator.DIVERSITY: 1}

    def check(self, settings: Settings, given: Mapping[str, Any]) -> None:
        """Also refuse genetic variation, and critics that train while their next experience is made."""
        super().check(settings, given)
        if "n_evo" in given:
            raise SettingsError(
                f"n_evo is {settings.n_evo}, but {self.name} makes no offspring by genetic variation; leave n_evo out."
            )
        if settings.critic_start != "after_init":
            raise SettingsError(
                f"critic_start is '{settings.critic_start}', but {self.name} trains between generations only; "
                "leave critic_start out."
            )

    def check_task(self, spec: TaskSpec) -> None:
        """Refuse a task whose descriptor is not known at each step."""
        require_step_descriptor(spec)

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Half of the batch for quality, half for diversity; an odd place goes to quality."""
        b = settings.batch_size
        n_quality = (b + 1) // 2
        return [
            Slots(Operator.QUALITY, 0, n_quality),
            Slots(Operator.DIVERSITY, n_quality, b - n_quality),
        ]

    def uses_critics(self, settings: Settings) -> bool:
        """Always."""
        return True

    def choose_parents(
        self,
        archive: Archive,
        settings: Settings,
        generation: int,
        first: int,
        count: int,
        each: int,
    ) -> NDArray[np.int64]:
        """Take parents from the Pareto fronts of fitness and novelty, see `pareto_parents`.

        The parents of a whole generation are chosen at once, so any division of a batch gets the same.

        Raises:
            ArchiveError: The archive is empty.
            RequestError: An offspring is to have two parents, or has no place in the batch.
        """
        b = settings.batch_size
        if each != 1 or first + count > b:
            raise RequestError(
                f"Places {first} to {first + count - 1} are to have {each} parents each; in {self.name} places 0 to "
                f"{b - 1} have one."
            )
        rng = generator(settings.seed, Purpose.QDRL_SELECTION, generation)
        cells = pareto_parents(archive, settings.novelty_neighbors, rng, b)
        return cells[first : first + count, None]

    def make_learner(self, spec: TaskSpec, settings: Settings, workers: int = 1) -> Learner:
        """Return one that has critics of diversity, too."""
        from pga_me_ros.core.qd_rl_learner import QdRlLearner

        return QdRlLearner(spec, settings, workers)
