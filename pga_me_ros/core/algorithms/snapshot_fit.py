"""Check that a snapshot can belong to a run: any node may publish one, so receivers validate it."""

from __future__ import annotations

import numpy as np

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import CRITIC, Snapshot
from pga_me_ros.errors import RequestError
from pga_me_ros.tasks.spec import TaskSpec


def require_fit(snapshot: Snapshot, spec: TaskSpec, settings: Settings) -> None:
    """Refuse a snapshot that cannot belong to a run.

    Args:
        snapshot: The snapshot.
        spec: Task of the run.
        settings: Settings of the run.

    Raises:
        RequestError: A network is missing, unexpected or has other layers than the run's, the states don't fit the run,
            or the generation is negative.
    """
    expected = algorithm_of(settings).snapshot_networks(spec, settings)
    for name in sorted(expected.keys() | snapshot.networks.keys()):
        if name not in snapshot.networks:
            raise RequestError(f"it has no network '{name}'; {settings.algorithm} needs one.")
        if name not in expected:
            raise RequestError(f"it has a network '{name}'; {settings.algorithm} has none.")
        theirs, ours = list(snapshot.networks[name][0].sizes), list(expected[name].sizes)
        if theirs != ours:
            raise RequestError(f"layers of network '{name}' are {theirs}, the run's are {ours}.")
    sets = 1 if settings.pg_batches == "shared" else settings.batch_size
    fitting = (sets, settings.transition_batch, spec.observation_dim)
    critics = CRITIC in expected
    _require_states(snapshot, fitting if critics else (0, 0, 0))
    if snapshot.generation < 0 or (critics and not snapshot.states.size):
        raise RequestError("its generation is negative, or it holds no states.")


def _require_states(snapshot: Snapshot, ours: tuple[int, int, int]) -> None:
    theirs = tuple(np.delete(snapshot.states.shape, 1).tolist())  # n_grad may change during a run
    if theirs != ours:
        raise RequestError(
            f"sets, batch size and entries of its states are {theirs}, the run's are {ours}."
        )
