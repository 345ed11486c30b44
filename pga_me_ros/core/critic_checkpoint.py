"""Critic states on disk, one file per generation, so that a run can continue exactly where it was."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.checkpoint import load_checkpoint, save_checkpoint
from pga_me_ros.core.errors import StorageError
from pga_me_ros.core.generation_files import GenerationFiles
from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.schedule import TrainingOrder
from pga_me_ros.core.snapshot import Snapshot

KEPT = 3
"""Newest checkpoints that are kept: a run may be resumed one generation before the newest."""

STATE = "state."
SNAPSHOT = "snapshot."

CriticState = dict[str, NDArray[Any]]
"""What `Learner.state` returns: networks, targets and optimisers by name."""


class CriticCheckpoints:
    """Checkpoints in the folder of a run, each the outcome of one training.

    Args:
        directory: The folder; made if absent.

    Raises:
        StorageError: The folder cannot be made.
    """

    def __init__(self, directory: Path) -> None:
        self._files = GenerationFiles(directory, "critic")

    def save(self, order: TrainingOrder, snapshot: Snapshot, state: CriticState) -> None:
        """Make the outcome of a training durable, and drop what can no longer be needed.

        That is what is older than the newest `KEPT`, and what was trained for later generations: those
        trainings started from a state that this one replaces.

        Raises:
            StorageError: The file cannot be written.
        """
        arrays = {f"{STATE}{name}": value for name, value in state.items()}
        meta: dict[str, Any] = {"order": dataclasses.asdict(order)}
        for f in dataclasses.fields(Snapshot):
            value = getattr(snapshot, f.name)
            if isinstance(value, np.ndarray):
                arrays[f"{SNAPSHOT}{f.name}"] = value
            elif isinstance(value, MlpShape):
                meta[f.name] = list(value.sizes)
            else:
                meta[f.name] = value
        save_checkpoint(self._files.path(order.generation), arrays, meta)
        generations = self._files.generations()
        stale = [g for g in generations if g > order.generation]
        old = [g for g in generations if g <= order.generation][:-KEPT]
        for generation in stale + old:
            self._files.delete(generation)

    def find(self, order: TrainingOrder) -> tuple[Snapshot, CriticState] | None:
        """Return the outcome of exactly this training, if it was done before.

        Raises:
            StorageError: Its file is damaged.
        """
        if order.generation not in self._files.generations():
            return None
        snapshot, state, theirs = self._load(order.generation)
        return (snapshot, state) if theirs == order else None

    def before(self, generation: int) -> tuple[Snapshot, CriticState] | None:
        """Return the newest outcome for an earlier generation, None when there is none.

        Raises:
            StorageError: Its file is damaged.
        """
        newest = self.newest_before(generation)
        return None if newest is None else self._load(newest)[:2]

    def newest_before(self, generation: int) -> int | None:
        """Return the newest earlier generation whose outcome is here, None when there is none."""
        return max((g for g in self._files.generations() if g < generation), default=None)

    def discard_since(self, generation: int) -> None:
        """Delete the outcomes of trainings that took place in a generation or later.

        A run that was killed in the middle of a generation does it again, perhaps with other rates. If those need no
        critics, nothing replaces what was trained the first time, and some later training would start from a state that
        an undisturbed run never had.

        Raises:
            StorageError: The file for that generation is damaged, or one cannot be deleted.
        """
        for trained_for in self._files.generations():
            # Critics for a later generation were trained in this one at the earliest; those for this one may
            # have been trained in the one before.
            if trained_for > generation or (
                trained_for == generation and self._load(generation)[2].ordered_in >= generation
            ):
                self._files.delete(trained_for)

    def _load(self, generation: int) -> tuple[Snapshot, CriticState, TrainingOrder]:
        path = self._files.path(generation)
        arrays, meta = load_checkpoint(path)
        values: dict[str, Any] = {
            n.removeprefix(SNAPSHOT): a for n, a in arrays.items() if n.startswith(SNAPSHOT)
        }
        state = {n.removeprefix(STATE): a for n, a in arrays.items() if n.startswith(STATE)}
        try:
            order = TrainingOrder(**meta.pop("order"))
            values |= {name: _plain_or_shape(name, value) for name, value in meta.items()}
            snapshot = Snapshot(**values)
        except (KeyError, TypeError) as error:
            raise StorageError(
                f"'{path}' holds no outcome of a critic training ({error}); restore it from a copy, "
                "or start the run anew."
            ) from error
        return snapshot, state, order


def _plain_or_shape(name: str, value: Any) -> Any:
    return MlpShape(tuple(value)) if name.endswith("_shape") and value is not None else value
