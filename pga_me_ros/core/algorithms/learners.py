"""The learner of each algorithm, in a file of its own because it imports torch, which light processes must not."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from pga_me_ros.core.algorithms.dcrl.learner import DcrlLearner
from pga_me_ros.core.algorithms.map_elites_es.learner import EsLearner
from pga_me_ros.core.algorithms.qd_rl.learner import QdRlLearner
from pga_me_ros.core.algorithms.td3.learner import Td3Learner
from pga_me_ros.core.learning.critic_learner import CriticLearner
from pga_me_ros.core.learning.learner import Learner
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.spec import TaskSpec

LEARNERS: Mapping[str, Callable[[TaskSpec, Settings, int], Learner]] = {
    "td3": Td3Learner,
    "map_elites_es": lambda spec, settings, _: EsLearner(spec, settings),
    "qd_rl": QdRlLearner,
    "dcrl_map_elites": DcrlLearner,
}
"""Learners by the value of the setting `algorithm`; `CriticLearner` for the others."""


def make_learner(spec: TaskSpec, settings: Settings, workers: int = 1) -> Learner:
    """Return the learner, which learns from experience and makes a snapshot for each generation.

    Args:
        spec: Task.
        settings: Settings of the run.
        workers: Threads of training; no result depends on their number.

    Raises:
        SettingsError: The device cannot be used here.
        PgaError: The machine cannot reserve memory for `replay_size` transitions.
    """
    return LEARNERS.get(settings.algorithm, CriticLearner)(spec, settings, workers)
