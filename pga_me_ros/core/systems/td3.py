"""TD3 (Fujimoto et al. 2018; Alg. 2 of Nilsson & Cully 2021), with an archive that collects behaviours passively."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from pga_me_ros.core.elites import Operator
from pga_me_ros.core.errors import SettingsError
from pga_me_ros.core.systems.system import Slots, System

if TYPE_CHECKING:
    from pga_me_ros.core.learns import Learns
    from pga_me_ros.core.settings import Settings
    from pga_me_ros.tasks.spec import TaskSpec


class Td3(System):
    """One actor, which is the greedy controller: it acts with noise, and learns from all that it did.

    A generation is b episodes of the actor as it is then; afterwards it takes one training step for each of their
    steps.
    """

    name = "td3"
    title = "TD3"
    defaults: ClassVar = {"batch_size": 10, "schedule": "alternating"}
    parents: ClassVar[Mapping[Operator, int]] = {}

    def check(self, settings: Settings, given: Mapping[str, Any]) -> None:
        """Refuse what there is no room for: variation, and critics that train ahead of their actor."""
        if "n_evo" in given:
            raise SettingsError(
                f"n_evo is {settings.n_evo}, but all episodes of {self.name} are its actor's; leave n_evo out."
            )
        if settings.critic_start != "after_init":
            raise SettingsError(
                f"critic_start is '{settings.critic_start}', but {self.name} trains between generations only; "
                "leave critic_start out."
            )

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Alg. 2 line 7: the actor, in every place."""
        return [Slots(Operator.GREEDY, 0, settings.batch_size)]

    def uses_critics(self, settings: Settings) -> bool:
        """Always."""
        return True

    def exploration_sigma(self, settings: Settings, generation: int) -> float:
        """Alg. 2 line 7; the random controllers at the start explore by themselves."""
        return settings.exploration_sigma if generation >= settings.init_generations else 0.0

    def make_learner(self, spec: TaskSpec, settings: Settings, workers: int = 1) -> Learns:
        """Return one that trains for as many steps as the robot made."""
        from pga_me_ros.core.learner import StepwiseLearner

        return StepwiseLearner(spec, settings, workers)
