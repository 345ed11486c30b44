"""Restores a run's experience from a recording of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.evaluation import evaluation_ids
from pga_me_ros.core.runs.experience import Experience
from pga_me_ros.core.runs.run_directory import LOCK
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.file_lock import FileLock
from pga_me_ros.core.storage.generation_files import generations_of
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.recording.episodes import recorded_run
from pga_me_ros.recording.gaps import ranges
from pga_me_ros.tasks.registry import task_spec

FOLDER = "experience"

SPARE = 2
"""Number of generations that a run keeps beyond those in the replay buffer."""


def restore_experience(bag: Path, run: Path) -> str:
    """Write the experience files that a run needs and has lost, each as it was, byte for byte.

    Args:
        bag: Recording of that run.
        run: Its folder or repertoire file.

    Returns:
        What was done, as text.

    Raises:
        StorageError: The run cannot be read or is in use, or the recording is damaged or of another run.
        RequestError: The recording lacks episodes that the run has lost, or the run cannot be continued.
    """
    stored = StoredRun.load(run, elites=False)
    if stored.generations and stored.is_thinned:
        raise RequestError(
            f"'{run}' is a thinned repertoire, which cannot be continued and needs no experience; give the folder of "
            "the run that was recorded."
        )
    run = stored.file.parent
    info, settings = stored.info, stored.settings
    steps = [metrics.steps for metrics in stored.metrics]
    lost = _lost(run, settings, steps)
    if not lost:
        return f"'{run}' has all the experience that it needs"
    recorded = recorded_run(bag, info.run_id)
    wanted = {k for generation in lost for k in evaluation_ids(settings, generation)}
    heads = [head for head in recorded.heads if head.evaluation in wanted]
    if absent := sorted(wanted - {head.evaluation for head in heads}):
        raise RequestError(
            f"'{bag}' lacks {len(absent)} episodes of the generations that the run has lost: evaluations "
            f"{ranges(absent)}."
        )
    lock = FileLock(run / LOCK)
    try:
        experience, algorithm = Experience(run / FOLDER, settings), algorithm_of(settings)
        for generation, episodes in recorded.episodes(heads, task_spec(settings.task)):
            found = sum(episode.length for episode in episodes.values())
            if found != steps[generation]:
                raise StorageError(
                    f"Generation {generation} has {found} steps in '{bag}', but {steps[generation]} in the run: it was "
                    "repeated after it was recorded."
                )
            for evaluation, episode in episodes.items():
                experience.stage(generation, evaluation, algorithm.remembered(episode))
            experience.store(generation)
    finally:
        lock.release()
    return f"restored the experience of {len(lost)} generations of '{run}': {ranges(lost)}"


def _lost(run: Path, settings: Settings, steps: Sequence[int]) -> list[int]:
    """Return the generations whose experience a run needs but has no file of, ascending."""
    first, transitions = len(steps), 0
    while first and transitions < settings.replay_size:
        first -= 1
        transitions += steps[first]
    there = set(generations_of(run / FOLDER, FOLDER))
    return [g for g in range(max(0, first - SPARE), len(steps)) if g not in there]
