"""The actor of a stored run: one network for all its behaviors, as its newest critics have it (DCRL-MAP-Elites)."""

from __future__ import annotations

from pga_me_ros.core.algorithms import ALGORITHMS, algorithm_of
from pga_me_ros.core.networks.conditioned import ConditionedActor
from pga_me_ros.core.runs.critic_checkpoints import newest_snapshot
from pga_me_ros.core.snapshot import ACTOR
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, StorageError


def stored_actor(run: StoredRun) -> ConditionedActor:
    """Return the actor of a run, finished or under way: the one whose training ended last.

    Args:
        run: The run; its folder has the checkpoints of its critics.

    Raises:
        RequestError: The algorithm of the run learns no such actor.
        StorageError: There is no checkpoint, or it is damaged or of another run.
    """
    if not algorithm_of(run.settings).conditioned:
        known = ", ".join(name for name, a in ALGORITHMS.items() if a.conditioned)
        raise RequestError(
            f"'{run.file}' is of algorithm {run.settings.algorithm}, which learns no actor that can be asked for a "
            f"descriptor; {known} does. Choose one of its behaviors instead."
        )
    snapshot = newest_snapshot(run.file.parent)
    if snapshot is None:
        raise StorageError(
            f"There is no critic-*.ckpt next to '{run.file}', which would hold the actor: no training has ended yet, "
            "or the repertoire was copied without them."
        )
    return ConditionedActor(run.spec, *snapshot.network(ACTOR))
