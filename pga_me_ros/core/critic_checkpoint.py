"""Critic states on disk, one file per generation, so that a run can continue exactly where it was."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.checkpoint import load_checkpoint, save_checkpoint
from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.schedule import TrainingOrder
from pga_me_ros.core.snapshot import Snapshot

FILE_PATTERN = re.compile(r"critic-(\d{8})\.ckpt")

KEPT = 3
"""Newest checkpoints that are kept: a run may be resumed one generation before the newest."""


class CriticCheckpoints:
    """Checkpoints in the folder of a run.

    Args:
        directory: Folder; must exist.
    """

    def __init__(self, directory: Path) -> None:
        self._dir = directory

    def save(
        self, order: TrainingOrder, snapshot: Snapshot, state: dict[str, NDArray[Any]]
    ) -> None:
        """Make the outcome of a training durable, and drop what can no longer be needed.

        Raises:
            StorageError: The file cannot be written.
        """
        arrays = {f"state.{name}": value for name, value in state.items()}
        meta: dict[str, Any] = {"order": dataclasses.asdict(order)}
        for f in dataclasses.fields(Snapshot):
            value = getattr(snapshot, f.name)
            if isinstance(value, np.ndarray):
                arrays[f"snapshot.{f.name}"] = value
            elif isinstance(value, MlpShape):
                meta[f.name] = list(value.sizes)
            else:
                meta[f.name] = value
        save_checkpoint(self._path(order.generation), arrays, meta)
        generations = self._generations()
        stale = [g for g in generations if g > order.generation]
        old = [g for g in generations if g <= order.generation][:-KEPT]
        for generation in stale + old:
            self._path(generation).unlink()

    def find(self, order: TrainingOrder) -> tuple[Snapshot, dict[str, NDArray[Any]]] | None:
        """Return the outcome of exactly this training, if it was done before.

        Raises:
            StorageError: Its file is damaged.
        """
        if order.generation not in self._generations():
            return None
        snapshot, state, theirs = self._load(order.generation)
        return (snapshot, state) if theirs == dataclasses.asdict(order) else None

    def before(self, generation: int) -> tuple[Snapshot, dict[str, NDArray[Any]]] | None:
        """Return the newest outcome for an earlier generation, None when there is none.

        Raises:
            StorageError: Its file is damaged.
        """
        earlier = [g for g in self._generations() if g < generation]
        return self._load(earlier[-1])[:2] if earlier else None

    def _load(self, generation: int) -> tuple[Snapshot, dict[str, NDArray[Any]], dict[str, Any]]:
        arrays, meta = load_checkpoint(self._path(generation))
        values: dict[str, Any] = {}
        for f in dataclasses.fields(Snapshot):
            if f.name.endswith("_shape"):
                values[f.name] = MlpShape(tuple(meta[f.name]))
            else:
                values[f.name] = arrays.get(f"snapshot.{f.name}", meta.get(f.name))
        prefix = "state."
        state = {n.removeprefix(prefix): a for n, a in arrays.items() if n.startswith(prefix)}
        return Snapshot(**values), state, meta["order"]

    def _path(self, generation: int) -> Path:
        return self._dir / f"critic-{generation:08d}.ckpt"

    def _generations(self) -> list[int]:
        matches = (FILE_PATTERN.fullmatch(p.name) for p in self._dir.iterdir())
        return sorted(int(m[1]) for m in matches if m)
