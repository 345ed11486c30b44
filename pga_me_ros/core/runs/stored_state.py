"""What a resumed run needs besides its repertoire: checked before any node starts."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.plan import training_for, training_meanwhile
from pga_me_ros.core.runs.experience import Experience
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.checkpoint import load_checkpoint
from pga_me_ros.core.storage.files import rename_file
from pga_me_ros.core.storage.generation_files import GenerationFiles
from pga_me_ros.errors import StorageError
from pga_me_ros.yaml_files import parameter_word

DAMAGED = ".damaged"
"""Suffix of a file that is set aside."""


def require_sound_state(
    path: Path, history: Sequence[Mapping[str, Any]], before: Settings, settings: Settings
) -> list[str]:
    """Make sure that critics and experience of a run are present and undamaged.

    A damaged outcome of the newest training is never used; it is set aside if the training can be repeated, bit for
    bit, from the outcome before.

    Args:
        path: Folder of the run.
        history: Rates of each committed generation.
        before: Settings with the rates of the last one.
        settings: Settings with the rates of the next one.

    Returns:
        What was damaged or missing, in words.

    Raises:
        StorageError: A file that cannot be recreated is damaged or missing.
    """
    files = GenerationFiles(path, "critic")
    damage = _damage(files)
    sound = set(files.generations()) - damage.keys()
    trained = list(islice(_trainings(history, settings), 2))
    lost = [g for g in trained[:1] if g not in sound]
    notes = []
    if lost:
        _require_repeatable(len(history), trained, sound, before, settings, files, damage)
        notes.append(_done_again(files.path(lost[0]).name, damaged=lost[0] in damage))
    if lost or (trained and algorithm_of(settings).uses_critics(settings)):
        experience = Experience(path / "experience", settings)
        for newest in range(len(history) - 1 - len(lost), len(history)):
            for generation in experience.window(newest):
                experience.episodes(generation)
    for generation in damage:
        file = files.path(generation)
        rename_file(file, file.with_name(file.name + DAMAGED))
        notes.append(f"{file.name} is damaged and was renamed to {file.name}{DAMAGED}")
    return notes


def _done_again(name: str, *, damaged: bool) -> str:
    if damaged:
        return f"the training that made {name} is repeated"
    return f"the training for {name} had not finished, or its file was removed; it is done now"


def _damage(files: GenerationFiles) -> dict[int, str]:
    """Return what is wrong with each damaged file, by generation."""
    found = {}
    for generation in files.generations():
        try:
            load_checkpoint(files.path(generation))
        except StorageError as error:
            found[generation] = str(error)
    return found


def _trainings(history: Sequence[Mapping[str, Any]], settings: Settings) -> Iterator[int]:
    """Yield the generations that committed generations trained critics for, newest first."""
    known: dict[tuple[tuple[str, Any], ...], Settings] = {}

    def at(t: int) -> Settings:
        rates = tuple(history[t].items())  # rates never change in most runs
        return known.get(rates) or known.setdefault(rates, settings.with_rates(history[t]))

    newest = len(history) + 1
    for t in reversed(range(len(history))):
        now, before = at(t), at(max(t - 1, 0))
        for order in (training_meanwhile(now, t), training_for(now, before, t)):
            if order is not None and order.generation < newest:
                newest = order.generation
                yield newest


def _require_repeatable(
    t: int,
    trained: Sequence[int],
    sound: Collection[int],
    before: Settings,
    settings: Settings,
    files: GenerationFiles,
    damage: Mapping[int, str],
) -> None:
    """Make sure that generation t repeats the newest training, and with the same outcome.

    Raises:
        StorageError: The training cannot be repeated.
    """
    ordered_again = trained[0] == t and training_for(settings, before, t) is not None
    # The first training starts the greedy controller at the best one, which has changed since.
    has_start = trained[1] in sound if trained[1:] else settings.greedy_init != "best"
    if not (ordered_again and has_start):
        lost = files.path(trained[0])
        repertoire = parameter_word("repertoire", f"{lost.parent}/repertoire.db")
        reason = damage.get(trained[0], f"The critics '{lost}' are missing; restore them.")
        raise StorageError(
            f"{reason} Their training cannot be repeated either. The repertoire next to it is sound; to serve it: "
            f"ros2 run pga_me_ros archive_manager --ros-args -p {repertoire}"
        )
