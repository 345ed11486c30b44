"""The actor of a stored run: one network for all its behaviors, as its newest critics have it (DCRL-MAP-Elites)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pga_me_ros.core.algorithms import ALGORITHMS, algorithm_of
from pga_me_ros.core.networks.conditioned import ConditionedActor
from pga_me_ros.core.runs.critic_checkpoints import newest_whole_snapshot
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import ACTOR
from pga_me_ros.core.storage.actor_file import FILE, load_actor
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import NetworkError, RequestError, StorageError
from pga_me_ros.tasks.spec import TaskSpec


class NoActorError(RequestError):
    """The repertoire has no actor: its algorithm learns none, no training has ended yet, or it was left behind."""


@dataclass(frozen=True)
class StoredActor:
    """The actor of a run, finished or under way: the one whose training ended last.

    Attributes:
        actor: The network.
        generation: Generation for whose offspring it was trained.
        note: What whoever uses it should be told, empty for nothing: a newer one is damaged.
    """

    actor: ConditionedActor
    generation: int
    note: str = ""

    @classmethod
    def of(cls, run: StoredRun) -> StoredActor:
        """Read the actor of a stored run.

        Raises:
            PgaError: As in `load`.
        """
        return cls.load(run.file, run.info.run_id, run.spec, run.settings)

    @classmethod
    def load(cls, file: Path, run_id: str, spec: TaskSpec, settings: Settings) -> StoredActor:
        """Read the actor from the newest whole checkpoint of critics, or from the file that `thin` wrote.

        Args:
            file: The repertoire file; the others are next to it.
            run_id: Its run.
            spec: Its task.
            settings: Its settings.

        Raises:
            NoActorError: The algorithm of the run learns none, or there is none (yet).
            StorageError: It is damaged, or of another run.
        """
        if not algorithm_of(settings).conditioned:
            known = ", ".join(name for name, a in ALGORITHMS.items() if a.conditioned)
            raise NoActorError(
                f"'{file}' is of algorithm {settings.algorithm}, which learns no actor that can be asked for a "
                f"descriptor; {known} does. Choose one of its behaviors instead."
            )
        snapshot, note = newest_whole_snapshot(file.parent)
        if snapshot is None and file.with_name(FILE).exists():
            return cls(*load_actor(file, run_id, spec))
        if snapshot is None:
            raise NoActorError(
                f"Next to '{file}' there is no critic-*.ckpt and no {FILE}, which would hold the actor: no training "
                "has ended yet, or the repertoire was copied without them."
            )
        try:
            actor = ConditionedActor(spec, *snapshot.network(ACTOR))
        except (NetworkError, RequestError) as error:
            raise StorageError(
                f"The checkpoints next to '{file}' are not of its run: {error}"
            ) from None
        return cls(actor, snapshot.generation, note)
