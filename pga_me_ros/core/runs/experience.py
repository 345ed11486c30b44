"""Experience of a run, generation by generation: complete before it is used, durable before it counts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.evaluation import evaluation_ids
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.field import INT64_MAX
from pga_me_ros.core.storage.checkpoint import (
    checkpoint_shapes,
    load_checkpoint,
    save_checkpoint,
)
from pga_me_ros.core.storage.generation_files import GenerationFiles
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.tasks.rollout import Episode


class Experience:
    """Episodes of whole generations, in evaluation order, one file each.

    Episodes may arrive in any order, twice, or not at all; `missing` returns those of a generation that have not
    arrived. Files that have left the replay buffer's window are deleted.

    Args:
        directory: The folder of the files; made if absent.
        settings: Settings of the run.

    Raises:
        StorageError: The folder cannot be made.
    """

    def __init__(self, directory: Path, settings: Settings) -> None:
        self._files = GenerationFiles(directory, "experience")
        self._settings = settings
        self._staged: dict[int, dict[int, Episode]] = {}
        self._stored = -1  # newest generation stored by this object, not by an earlier process
        self._expected = max(self._files.generations(), default=-1)
        self._lengths: dict[int, int] = {}

    def stage(self, generation: int, evaluation: int, episode: Episode) -> bool:
        """Take an episode that has arrived.

        Returns:
            Whether it was new; a duplicate is dropped.

        Raises:
            RequestError: The evaluation does not belong to that generation.
        """
        ids = evaluation_ids(self._settings, generation)
        if generation < 0 or evaluation not in ids:
            raise RequestError(
                f"Evaluation {evaluation} is not of generation {generation}, which has "
                f"{ids.start} to {ids.stop - 1}."
            )
        staged = self._staged.setdefault(generation, {})
        if evaluation in staged:
            return False
        staged[evaluation] = episode
        return True

    def missing(self, generation: int) -> list[int]:
        """Return the ids of a generation's evaluations whose episodes have not arrived.

        A file of that generation does not count: if the run was killed between storing a generation and adding it to
        the archive, the generation may be repeated with other rates.
        """
        staged = self._staged.get(generation, {})
        return [k for k in evaluation_ids(self._settings, generation) if k not in staged]

    @property
    def stored(self) -> int:
        """Newest generation stored by this object, -1 for none."""
        return self._stored

    def awaits(self, generation: int) -> bool:
        """Whether a generation's episodes may still be needed: not if it is over or far ahead."""
        return self._stored <= generation <= max(self._stored, self._expected) + 1

    def expect(self, generation: int) -> None:
        """Announce that a generation is about to be stored, so that its episodes are accepted.

        The files cannot tell which one is next if the folder was restored from a copy, or lost.

        Raises:
            RequestError: A later generation is stored already, or the number is not a generation's.
        """
        last = evaluation_ids(self._settings, generation).stop
        if not max(self._stored, 0) <= generation or last > INT64_MAX:
            raise RequestError(
                f"The experience of generation {generation} cannot be stored; the newest stored now is of "
                f"generation {self._stored}."
            )
        self._expected = max(self._expected, generation)

    def drop_others(self, generation: int, fitness: Float64Array) -> None:
        """Drop episodes that do not belong to a generation's evaluations.

        An evaluator that outlives a killed orchestrator may continue with a generation that is then repeated with other
        rates; its episodes have the same ids, but another fitness.

        Args:
            generation: The generation.
            fitness: (b,) float64 fitness of its evaluations, in order.
        """
        staged = self._staged.get(generation, {})
        ids = evaluation_ids(self._settings, generation)
        for evaluation, expected in zip(ids, fitness.tolist(), strict=True):
            if evaluation in staged and staged[evaluation].fitness != expected:
                del staged[evaluation]

    def store(self, generation: int) -> None:
        """Write a complete generation to its file and delete files that are no longer needed.

        Raises:
            RequestError: Some of its episodes have not arrived.
            StorageError: The file cannot be written.
        """
        if missing := self.missing(generation):
            raise RequestError(
                f"{len(missing)} episodes of generation {generation} have not arrived, the first of "
                f"evaluation {missing[0]}; send them before it is stored."
            )
        episodes = self._staged_episodes(generation)
        save_checkpoint(self._files.path(generation), _pack(episodes), {"generation": generation})
        self._lengths[generation] = sum(e.length for e in episodes)
        self._stored = self._expected = generation
        for other in [g for g in self._staged if abs(g - generation) > 1]:
            del self._staged[other]
        self._drop_old(generation)

    def episodes(self, generation: int) -> Sequence[Episode]:
        """Return a generation's episodes in evaluation order.

        Raises:
            RequestError: The generation is neither complete nor stored.
            StorageError: Its file is damaged or belongs to another generation.
        """
        if not self.missing(generation):
            return self._staged_episodes(generation)
        path = self._files.path(generation)
        if not path.exists():
            raise RequestError(
                f"The experience of generation {generation} is not here; send its episodes."
            )
        arrays, meta = load_checkpoint(path)
        if meta.get("generation") != generation:
            raise StorageError(
                f"'{path}' holds {meta}, not the experience of generation {generation}; restore the "
                "file that belongs there, or start a new run."
            )
        return list(_unpack(arrays))

    def window(self, newest: int) -> range:
        """Return the newest generations that fit into the replay buffer, up to and including `newest`.

        Raises:
            StorageError: A generation is missing, or its file is damaged.
        """
        stop = max(newest, -1) + 1
        transitions, first = 0, stop
        while first > 0 and transitions < self._settings.replay_size:
            first -= 1
            if not self._files.path(first).exists():
                raise StorageError(
                    f"The experience of generation {first} is missing: if it was stored, restore "
                    f"'{self._files.path(first)}' or start a new run; if not, send its episodes first."
                )
            transitions += self._length(first)
        return range(first, stop)

    def _staged_episodes(self, generation: int) -> list[Episode]:
        return [e for _, e in sorted(self._staged[generation].items())]

    def _length(self, generation: int) -> int:
        if generation not in self._lengths:
            # If a damaged header gives a wrong length, reading the episodes will find out.
            shapes = checkpoint_shapes(self._files.path(generation))
            self._lengths[generation] = shapes.get("actions", (0,))[0]
        return self._lengths[generation]

    def _drop_old(self, newest: int) -> None:
        """Delete files whose transitions the replay buffer has all overwritten.

        Two generations more than the window are kept: a resumed run may train on a window that ends one generation
        before the newest, and repeat a training whose outcome is damaged on one that ends two before.
        """
        kept = 0
        for generation in reversed([g for g in self._files.generations() if g < newest - 1]):
            if kept >= self._settings.replay_size:
                self._files.delete(generation)
                self._lengths.pop(generation, None)
            else:
                kept += self._length(generation)


def _pack(episodes: Sequence[Episode]) -> dict[str, np.ndarray]:
    arrays = {
        "states": np.concatenate([e.states for e in episodes]),
        "actions": np.concatenate([e.actions for e in episodes]),
        "rewards": np.concatenate([e.rewards for e in episodes]),
        "lengths": np.array([e.length for e in episodes], np.int64),
        "fitness": np.array([e.fitness for e in episodes], np.float64),
        "descriptors": np.stack([e.descriptor for e in episodes]),
        "terminated": np.array([e.terminated for e in episodes], np.bool_),
    }
    if any(e.intended is not None for e in episodes):
        none = np.full_like(episodes[0].descriptor, np.nan)
        aims = [none if e.intended is None else e.intended for e in episodes]
        arrays["intended"] = np.stack(aims)
    return arrays


def _unpack(arrays: dict[str, np.ndarray]) -> Iterator[Episode]:
    step = 0
    aims = arrays.get("intended", np.full_like(arrays["descriptors"], np.nan))
    for i, length in enumerate(arrays["lengths"].tolist()):
        yield Episode(
            states=arrays["states"][step + i : step + i + length + 1],
            actions=arrays["actions"][step : step + length],
            rewards=arrays["rewards"][step : step + length],
            fitness=float(arrays["fitness"][i]),
            descriptor=arrays["descriptors"][i],
            terminated=bool(arrays["terminated"][i]),
            intended=None if np.isnan(aims[i]).any() else aims[i],
        )
        step += length
