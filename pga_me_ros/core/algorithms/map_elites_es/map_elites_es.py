"""MAP-Elites-ES (Colas, Madhavan, Huizinga & Clune 2020): MAP-Elites whose steps are those of an evolution strategy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from pga_me_ros.arrays import BoolArray, Int64Array
from pga_me_ros.core.algorithms.algorithm import Algorithm, Slots
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import CENTER, GREEDY
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec


class MapElitesEs(Algorithm):
    """A generation is one step: the controller that the last step led to, and samples around the center of this one.

    Samples count as evaluations, but only what a step led to is offered to the archive.
    """

    name = "map_elites_es"
    title = "MAP-Elites-ES"
    operators = (Operator.GREEDY, Operator.ES_SAMPLE)
    learns_critics = False

    def batch_plan(self, settings: Settings, generation: int, imported: int = 0) -> list[Slots]:
        """Return which operator fills which places: the first step is from a random controller."""
        center = Operator.RANDOM if generation == 0 else Operator.GREEDY
        return [Slots(center, 0, 1), Slots(Operator.ES_SAMPLE, 1, settings.es_samples)]

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Return the plan of a generation; all but the first are alike."""
        return self.batch_plan(settings, generation)

    def uses_critics(self, settings: Settings) -> bool:
        """Always: each step takes the place of a training."""
        return True

    def snapshot_networks(self, spec: TaskSpec, settings: Settings) -> Mapping[str, MlpShape]:
        """Return the layers of what the last step led to, and of the center of the samples."""
        shape = controller_shape(spec, settings)
        return {GREEDY: shape, CENTER: shape}

    def offered(self, operators: Int64Array) -> BoolArray:
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
