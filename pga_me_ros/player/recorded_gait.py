"""Episodes of a stored gait, recorded for drawing: its own evaluation again, or one from another start."""

from __future__ import annotations

import numpy as np

from pga_me_ros.core.evaluation import as_evaluated, evaluation_rng
from pga_me_ros.core.settings import Settings
from pga_me_ros.player.gait import Gait
from pga_me_ros.player.watched_rollout import Recording, record
from pga_me_ros.tasks.protocol import Task


def steps_between(pictures_per_second: float, period: float) -> int:
    """Return how many steps lie between two pictures, at least one.

    Args:
        pictures_per_second: Pictures per simulated second that are wanted.
        period: Time of a step, s.
    """
    return max(1, round(1.0 / (pictures_per_second * period)))


def evaluated_again(
    task: Task, settings: Settings, gait: Gait, every: int, seed: int | None = None
) -> Recording:
    """Run a behavior from the very start of its evaluation, and keep the states of the robot.

    Args:
        task: The task of its run.
        settings: Settings of its run.
        gait: The behavior.
        every: Steps between two states.
        seed: Seed of another initial pose, None for that of the evaluation.

    Raises:
        TaskError: The task has no `body`, or its robot cannot be shown.
    """
    if seed is not None:
        return record(task, gait.controller, np.random.default_rng(seed), every)
    act = as_evaluated(settings, gait.controller, gait.evaluation)
    return record(task, act, evaluation_rng(settings.seed, gait.evaluation), every)
