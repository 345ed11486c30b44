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
    """A generation is one ES step: the controller that the last step reached, and samples around this one's center.

    Samples count as evaluations, but only the controllers that steps reach are offered to the archive.
    """

    name = "map_elites_es"
    title = "MAP-Elites-ES"
    operators = (Operator.GREEDY, Operator.ES_SAMPLE)
    learns_critics = False

    def batch_plan(self, settings: Settings, generation: int, imported: int = 0) -> list[Slots]:
        """Return which operator fills which places: the first step starts from a random controller."""
        center = Operator.RANDOM if generation == 0 else Operator.GREEDY
        return [Slots(center, 0, 1), Slots(Operator.ES_SAMPLE, 1, settings.es_samples)]

    def offspring(self, settings: Settings, generation: int) -> list[Slots]:
        """Return the plan of a generation; all but the first are alike."""
        return self.batch_plan(settings, generation)

    def uses_critics(self, settings: Settings) -> bool:
        """Always: each ES step takes the place of critic training."""
        return True

    def snapshot_networks(self, spec: TaskSpec, settings: Settings) -> Mapping[str, MlpShape]:
        """Return the shapes of the controller that the last step reached and of the center of the samples."""
        shape = controller_shape(spec, settings)
        return {GREEDY: shape, CENTER: shape}

    def offered(self, operators: Int64Array) -> BoolArray:
        """Offer all but the samples."""
        return operators != Operator.ES_SAMPLE

    def remembered(self, episode: Episode) -> Episode:
        """Return an episode cut to its first step: learning needs only its fitness and descriptor."""
        return replace(
            episode,
            states=episode.states[:2].copy(),
            actions=episode.actions[:1].copy(),
            rewards=episode.rewards[:1].copy(),
        )
