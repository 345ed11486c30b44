"""The learner of TD3."""

from __future__ import annotations

from collections.abc import Iterable

from pga_me_ros.core.learning.critic_learner import CriticLearner
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec


class Td3Learner(CriticLearner):
    """Takes one training step per environment step of the newest generation (Alg. 2); n_crit is not used.

    Steps are counted over the whole run, as in TD3, so which of them also update the actor does not depend on how they
    are divided among trainings.
    """

    def __init__(self, spec: TaskSpec, settings: Settings, workers: int = 1) -> None:
        super().__init__(spec, settings, workers)
        self._robot_steps = 0

    def add(self, generation: int, episodes: Iterable[Episode]) -> None:
        """Add one generation's experience as `CriticLearner` does, and count its environment steps."""
        episodes = list(episodes)
        super().add(generation, episodes)
        self._robot_steps = sum(e.length for e in episodes)

    def _steps(self, rates: Settings) -> range:
        """Return the numbers of this training's steps, counted from the start of the run."""
        return range(self.version + 1, self.version + self._robot_steps + 1)
