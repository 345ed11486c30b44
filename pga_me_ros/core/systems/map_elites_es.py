"""MAP-Elites-ES (Colas, Madhavan, Huizinga & Clune 2020): MAP-Elites whose steps are an evolution strategy's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.elites import Operator
from pga_me_ros.core.errors import SettingsError
from pga_me_ros.core.systems.system import Slots, System

if TYPE_CHECKING:
    from pga_me_ros.core.learns import Learns
    from pga_me_ros.core.settings import Settings
    from pga_me_ros.tasks.rollout import Episode
    from pga_me_ros.tasks.spec import TaskSpec

ELSEWHERE = {
    "n_evo": "makes its offspring by steps of an evolution strategy",
    "start_from": "starts from a single random controller",
    "random_init": "starts from a single random controller",
    "critic_start": "has no critics",
    "greedy_init": "has no critics",
    "replay_size": "has no replay buffer",
}
"""Settings that others have a use for, and why it has none."""


class MapElitesEs(System):
    """A generation is one step: the controller that the step before led to, and samples around the centre of this one.

    Samples count as evaluations, but only what a step led to is offered to the archive.
    """

    name = "map_elites_es"
    title = "MAP-Elites-ES"
    # The newest generation is all that a step is taken on, so the replay buffer's window is as short as can be.
    defaults: ClassVar = {"random_init": 1, "schedule": "alternating", "replay_size": 1}
    parents: ClassVar = {Operator.ES_SAMPLE: 0}
    learns_critics = False

    def own_values(self, settings: Settings) -> Mapping[str, Any]:
        """Also derive the batch: all samples and one more."""
        return {**self.defaults, "batch_size": 1 + settings.es_samples}

    def check(self, settings: Settings, given: Mapping[str, Any]) -> None:
        """Refuse what there is no room for, and samples that cannot be mirrored."""
        if settings.es_samples % 2:
            raise SettingsError(
                f"es_samples is {settings.es_samples}, but samples come in mirrored pairs; give an even number."
            )
        if settings.batch_size != 1 + settings.es_samples:
            raise SettingsError(
                f"batch_size is {settings.batch_size}, but a generation of {self.name} has es_samples + 1 = "
                f"{1 + settings.es_samples} controllers; leave batch_size out and choose es_samples."
            )
        for name, why in ELSEWHERE.items():
            if name in given and given[name] != self.defaults.get(name):
                raise SettingsError(
                    f"{name} is {given[name]!r}, but {self.name} {why}; leave {name} out."
                )

    def batch_plan(self, settings: Settings, generation: int, imported: int = 0) -> list[Slots]:
        """Return which operator fills which places: the first step is from a random controller."""
        center = Operator.RANDOM if generation == 0 else Operator.GREEDY
        return [Slots(center, 0, 1), Slots(Operator.ES_SAMPLE, 1, settings.es_samples)]

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Return the plan of a generation, all but the first being alike."""
        return self.batch_plan(settings, generation)

    def uses_critics(self, settings: Settings) -> bool:
        """Always: each step takes the place of a training."""
        return True

    def offered(self, operators: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return all but the samples."""
        return operators != Operator.ES_SAMPLE

    def remembered(self, episode: Episode) -> Episode:
        """Return the first step of an episode: of the others, only what they added up to matters."""
        return replace(
            episode,
            states=episode.states[:2].copy(),
            actions=episode.actions[:1].copy(),
            rewards=episode.rewards[:1].copy(),
        )

    def make_learner(self, spec: TaskSpec, settings: Settings, workers: int = 1) -> Learns:
        """Return the evolution strategy."""
        from pga_me_ros.core.es_learner import EsLearner

        return EsLearner(spec, settings)
