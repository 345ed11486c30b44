"""Critic states on disk, one file per generation, so that a run can resume exactly where it was."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.plan import TrainingOrder
from pga_me_ros.core.snapshot import CENTER, CRITIC, DIVERSITY_CRITIC, GREEDY, Network, Snapshot
from pga_me_ros.core.storage.checkpoint import load_checkpoint, save_checkpoint
from pga_me_ros.core.storage.generation_files import GenerationFiles, generations_of
from pga_me_ros.errors import NetworkError, StorageError

STEM = "critic"
"""What the files' names begin with."""

KEPT = 3
"""Number of newest checkpoints that are kept: a run may be resumed one generation before the newest."""

STATE_PREFIX = "state."
SNAPSHOT_PREFIX = "snapshot."
NETWORK_PREFIX = f"{SNAPSHOT_PREFIX}networks."

CriticState = dict[str, NDArray[Any]]
"""What `CriticLearner.state` returns: networks, targets and optimizers by name."""


class CriticCheckpoints:
    """Checkpoints in the folder of a run, each the outcome of one training.

    Args:
        directory: The folder; made if absent.

    Raises:
        StorageError: The folder cannot be made.
    """

    def __init__(self, directory: Path) -> None:
        self._files = GenerationFiles(directory, STEM)

    def save(self, order: TrainingOrder, snapshot: Snapshot, state: CriticState) -> None:
        """Make the outcome of a training durable, and delete what is no longer needed.

        That is everything older than the newest `KEPT`, and outcomes for later generations: those
        trainings started from a state that this one replaces.

        Raises:
            StorageError: The file cannot be written.
        """
        arrays = {f"{STATE_PREFIX}{name}": value for name, value in state.items()}
        meta: dict[str, Any] = {"order": dataclasses.asdict(order)}
        for f in dataclasses.fields(Snapshot):
            if f.name not in ("networks", "states"):
                meta[f.name] = getattr(snapshot, f.name)
        arrays[f"{SNAPSHOT_PREFIX}states"] = snapshot.states
        meta["networks"] = {n: list(shape.sizes) for n, (shape, _) in snapshot.networks.items()}
        for name, (_, parameters) in snapshot.networks.items():
            arrays[f"{NETWORK_PREFIX}{name}"] = parameters
        save_checkpoint(self._files.path(order.generation), arrays, meta)
        generations = self._files.generations()
        stale = [g for g in generations if g > order.generation]
        old = [g for g in generations if g <= order.generation][:-KEPT]
        for generation in stale + old:
            self._files.delete(generation)

    def find(self, order: TrainingOrder) -> tuple[Snapshot, CriticState] | None:
        """Return the outcome of exactly this training, None if it was not done before.

        Raises:
            StorageError: Its file is damaged.
        """
        if order.generation not in self._files.generations():
            return None
        snapshot, state, theirs = self._load(order.generation)
        return (snapshot, state) if theirs == order else None

    def before(self, generation: int) -> tuple[Snapshot, CriticState] | None:
        """Return the newest outcome for an earlier generation, None if there is none.

        Raises:
            StorageError: Its file is damaged.
        """
        newest = self.newest_before(generation)
        return None if newest is None else self._load(newest)[:2]

    def newest_before(self, generation: int) -> int | None:
        """Return the newest earlier generation with an outcome, None if there is none."""
        return max((g for g in self._files.generations() if g < generation), default=None)

    def discard_since(self, generation: int) -> None:
        """Delete the outcomes of trainings that took place in a generation or later.

        A run that was killed in the middle of a generation repeats it, perhaps with other rates. If those need no
        critics, nothing replaces what was trained the first time, and a later training would start from a state that
        an undisturbed run never had.

        Raises:
            StorageError: The file for that generation is damaged, or one cannot be deleted.
        """
        for trained_for in self._files.generations():
            # Critics for later generations were trained in this one or later; those for this one may have
            # been trained in the one before.
            if trained_for > generation or (
                trained_for == generation and self._load(generation)[2].ordered_in >= generation
            ):
                self._files.delete(trained_for)

    def _load(self, generation: int) -> tuple[Snapshot, CriticState, TrainingOrder]:
        return _load(self._files.path(generation))


def newest_whole_snapshot(directory: Path) -> tuple[Snapshot | None, str]:
    """Return the snapshot of the newest training in the folder of a run whose file is whole.

    A run may be training meanwhile, and delete files that were there a moment ago.

    Returns:
        The snapshot, None if no training has ended; and which newer one is damaged, in words, empty for none.

    Raises:
        StorageError: All files are damaged; the message is about the newest.
    """
    damaged: list[StorageError] = []
    for generation in reversed(generations_of(directory, STEM)):
        path = directory / f"{STEM}-{generation:08d}.ckpt"
        try:
            snapshot, _, _ = _load(path)
        except StorageError as error:
            if path.exists():
                damaged.append(error)
            continue
        note = f"{damaged[0]} '{path.name}' is used instead." if damaged else ""
        return snapshot, note
    if damaged:
        raise damaged[0]
    return None, ""


def _load(path: Path) -> tuple[Snapshot, CriticState, TrainingOrder]:
    arrays, meta = load_checkpoint(path)
    state = {
        n.removeprefix(STATE_PREFIX): a for n, a in arrays.items() if n.startswith(STATE_PREFIX)
    }
    try:
        order = TrainingOrder(**meta.pop("order"))
        networks = _networks(arrays, meta) if "networks" in meta else _older(arrays, meta)
        states = arrays[f"{SNAPSHOT_PREFIX}states"]
        snapshot = Snapshot(**{**meta, "networks": networks, "states": states})
    except (KeyError, TypeError, AttributeError, NetworkError) as error:
        raise StorageError(
            f"'{path}' holds no outcome of a critic training ({error}); restore it from a copy, "
            "or start a new run."
        ) from error
    return snapshot, state, order


def _networks(arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> dict[str, Network]:
    return {
        name: (MlpShape(tuple(sizes)), arrays[f"{NETWORK_PREFIX}{name}"])
        for name, sizes in meta["networks"].items()
    }


def _older(arrays: Mapping[str, NDArray[Any]], meta: dict[str, Any]) -> dict[str, Network]:
    """Return the networks of an older file, which has a field for each, and remove those fields.

    Critics shared one field for their layers; without critics, it was empty, and so was the critic.
    """
    critic, controller = meta.pop("critic_shape"), meta.pop("greedy_shape")
    layers = {CRITIC: critic, GREEDY: controller, DIVERSITY_CRITIC: critic, CENTER: controller}
    for name in layers:
        meta.pop(name, None)
    return {
        name: (MlpShape(tuple(sizes)), arrays[f"{SNAPSHOT_PREFIX}{name}"])
        for name, sizes in layers.items()
        if sizes is not None and f"{SNAPSHOT_PREFIX}{name}" in arrays
    }
