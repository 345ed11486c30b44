"""Whether a snapshot can be one of a run: whoever hears it checks, as anybody can publish one."""

from __future__ import annotations

import numpy as np

from pga_me_ros.core.elites import Operator
from pga_me_ros.core.errors import RequestError
from pga_me_ros.core.policy import controller_shape, critic_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.systems import system_of
from pga_me_ros.tasks.spec import TaskSpec


def require_fit(snapshot: Snapshot, spec: TaskSpec, settings: Settings) -> None:
    """Refuse a snapshot of other networks, states or another system than a run's.

    Args:
        snapshot: The snapshot.
        spec: Task of the run.
        settings: Settings of the run.

    Raises:
        RequestError: It is one.
    """
    system, shape = system_of(settings), controller_shape(spec, settings)
    critics = system.learns_critics
    sets = 1 if settings.pg_batches == "shared" else settings.batch_size
    states = (sets, settings.transition_batch, spec.observation_dim)
    expected = {
        "layers of the greedy controller": shape.sizes,
        "layers of the critic": critic_shape(spec, settings).sizes if critics else (),
        "sets, batch size and entries of its states": states if critics else (0, 0, 0),
        "parameters of the samples' centre": 0 if critics else shape.parameter_count,
    }
    found = (
        snapshot.greedy_shape.sizes,
        snapshot.critic_shape.sizes if snapshot.critic_shape else (),
        tuple(np.delete(snapshot.states.shape, 1).tolist()),
        0 if snapshot.center is None else snapshot.center.size,
    )
    for (what, ours), theirs in zip(expected.items(), found, strict=True):
        if theirs != ours:
            raise RequestError(f"{what} are {theirs}, the run's are {ours}.")
    has, needs = snapshot.diversity_critic is not None, Operator.DIVERSITY in system.parents
    if has != needs:
        does = ("has none", "needs one")[needs]
        raise RequestError(
            f"it has {('no', 'a')[has]} diversity critic; algorithm '{settings.algorithm}' {does}."
        )
    if snapshot.generation < 0 or (critics and not snapshot.states.size):
        raise RequestError("its generation is negative, or it holds no states.")
