"""Experience of a run, generation by generation: complete before it is used, durable before it counts."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from pga_me_ros.core.checkpoint import load_checkpoint, save_checkpoint
from pga_me_ros.core.errors import RequestError, StorageError
from pga_me_ros.core.schedule import evaluation_ids
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.rollout import Episode

FILE = "experience-{:08d}.ckpt"
FILE_PATTERN = re.compile(r"experience-(\d{8})\.ckpt")


class Experience:
    """Episodes of whole generations, in evaluation order, one file each.

    Episodes may arrive in any order, twice, or not at all; `missing` tells which of a generation have not. What has
    fallen out of the replay buffer's window is deleted.

    Args:
        directory: Where the files are; made if absent.
        settings: Settings of the run.

    Raises:
        StorageError: The directory cannot be made.
    """

    def __init__(self, directory: Path, settings: Settings) -> None:
        self._dir = directory
        self._settings = settings
        self._staged: dict[int, dict[int, Episode]] = {}
        self._lengths: dict[int, int] = {}
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StorageError(
                f"Cannot make the folder '{directory}' ({error.strerror}); choose a run_dir that "
                "can be written to."
            ) from None

    def stage(self, generation: int, evaluation: int, episode: Episode) -> bool:
        """Take an episode that has arrived.

        Returns:
            Whether it was new; a duplicate is dropped.

        Raises:
            RequestError: The evaluation is not of that generation.
        """
        ids = evaluation_ids(self._settings, generation)
        if evaluation not in ids:
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
        """Return the evaluation ids of a generation that have not arrived."""
        staged = self._staged.get(generation, {})
        return [k for k in evaluation_ids(self._settings, generation) if k not in staged]

    def store(self, generation: int) -> None:
        """Write a complete generation to its file and drop what is too old to matter.

        Raises:
            StorageError: The file cannot be written.
        """
        episodes = [e for _, e in sorted(self._staged[generation].items())]
        save_checkpoint(self._path(generation), _pack(episodes), {"generation": generation})
        self._lengths[generation] = sum(e.length for e in episodes)
        for old in [g for g in self._staged if g < generation - 1]:
            del self._staged[old]
        self._drop_old(generation)

    def is_stored(self, generation: int) -> bool:
        """Whether a generation's file is there."""
        return self._path(generation).exists()

    def episodes(self, generation: int) -> Sequence[Episode]:
        """Return a generation's episodes in evaluation order.

        Raises:
            RequestError: It is neither staged completely nor stored.
            StorageError: Its file is damaged.
        """
        if generation in self._staged and not self.missing(generation):
            return [e for _, e in sorted(self._staged[generation].items())]
        if not self.is_stored(generation):
            raise RequestError(f"The experience of generation {generation} is not here.")
        arrays, _ = load_checkpoint(self._path(generation))
        return list(_unpack(arrays))

    def window(self, newest: int) -> range:
        """Return the stored generations up to one that the replay buffer is filled from.

        Raises:
            StorageError: A generation in between is missing.
        """
        stored = [g for g in self._stored_generations() if g <= newest]
        if not stored:
            if newest < 0:
                return range(0)
            raise StorageError(f"The folder '{self._dir}' holds no experience up to {newest}.")
        expected = range(stored[0], newest + 1)
        if stored != list(expected):
            gap = min(set(expected) - set(stored))
            raise StorageError(
                f"The experience of generation {gap} is missing in '{self._dir}'; restore the file "
                f"'{FILE.format(gap)}' or start a new run."
            )
        return expected

    def _path(self, generation: int) -> Path:
        return self._dir / FILE.format(generation)

    def _stored_generations(self) -> list[int]:
        matches = (FILE_PATTERN.fullmatch(p.name) for p in self._dir.iterdir())
        return sorted(int(m[1]) for m in matches if m)

    def _length(self, generation: int) -> int:
        if generation not in self._lengths:
            self._lengths[generation] = sum(e.length for e in self.episodes(generation))
        return self._lengths[generation]

    def _drop_old(self, newest: int) -> None:
        """Delete files that hold only transitions that the replay buffer has overwritten.

        One generation more than the window is kept: a run that is resumed may train on all but the newest.
        """
        kept = 0
        for generation in range(newest - 1, -1, -1):
            if not self.is_stored(generation):
                return
            if kept >= self._settings.replay_size:
                self._path(generation).unlink()
                self._lengths.pop(generation, None)
            else:
                kept += self._length(generation)


def _pack(episodes: Sequence[Episode]) -> dict[str, np.ndarray]:
    return {
        "states": np.concatenate([e.states for e in episodes]),
        "actions": np.concatenate([e.actions for e in episodes]),
        "rewards": np.concatenate([e.rewards for e in episodes]),
        "lengths": np.array([e.length for e in episodes], np.int64),
        "fitness": np.array([e.fitness for e in episodes], np.float64),
        "descriptors": np.stack([e.descriptor for e in episodes]),
        "terminated": np.array([e.terminated for e in episodes], np.bool_),
    }


def _unpack(arrays: dict[str, np.ndarray]) -> Iterator[Episode]:
    step = 0
    for i, length in enumerate(arrays["lengths"].tolist()):
        yield Episode(
            states=arrays["states"][step + i : step + i + length + 1],
            actions=arrays["actions"][step : step + length],
            rewards=arrays["rewards"][step : step + length],
            fitness=float(arrays["fitness"][i]),
            descriptor=arrays["descriptors"][i],
            terminated=bool(arrays["terminated"][i]),
        )
        step += length
