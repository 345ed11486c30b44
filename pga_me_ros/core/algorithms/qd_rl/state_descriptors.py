"""State descriptors: an episode's behavior descriptor up to each of its steps (QD-RL, Cideron et al. 2020)."""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.archive.novelty import unit_box
from pga_me_ros.errors import TaskError
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec


def require_step_descriptor(spec: TaskSpec) -> None:
    """Check that a task has state descriptors.

    Raises:
        TaskError: The task's spec has no `step_descriptor_names`, observation entries whose mean is the descriptor.
    """
    if not spec.step_descriptor_names:
        raise TaskError(
            f"Task '{spec.name}' has no state descriptors; algorithm 'qd_rl' needs them for its diversity reward. If "
            "its descriptor is the mean of observation entries over the steps, name them in its spec "
            "(TaskSpec.step_descriptor_names); otherwise choose another algorithm."
        )


def state_descriptors(spec: TaskSpec, episode: Episode) -> Float32Array:
    """Return the descriptor of the episode up to and including each step, in shares of its range.

    For a locomotion task: each foot's share of the steps so far that ended with it on the floor. Observations may lag
    one step behind (`TaskSpec.step_descriptor_delay`) and miss the last step; the last row is the descriptor of the
    whole episode in any case.

    Args:
        spec: Task.
        episode: Episode of T steps.

    Returns:
        (T, d) float32 within [0, 1]; row t is the descriptor after step t, counted from 0.

    Raises:
        TaskError: The task has no state descriptors.
    """
    require_step_descriptor(spec)
    columns = [spec.observation_names.index(name) for name in spec.step_descriptor_names]
    shown = episode.states[1 + spec.step_descriptor_delay :, columns].astype(np.float64)
    before_last = shown[: episode.length - 1]
    steps = np.arange(1, episode.length)[:, None]
    shares = np.concatenate([before_last.cumsum(axis=0) / steps, episode.descriptor[None]])
    return unit_box(shares, spec.descriptor_low, spec.descriptor_high).astype(np.float32)
