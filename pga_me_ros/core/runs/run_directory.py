"""The folder of a run: made, or found and checked so that the run can be resumed."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.runs.memory_need import require_memory
from pga_me_ros.core.runs.start_from import with_controllers
from pga_me_ros.core.runs.stored_state import require_sound_state
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.file_lock import FileLock
from pga_me_ros.core.storage.files import make_folder
from pga_me_ros.core.storage.metrics_file import METRICS_FILE, MetricsFile
from pga_me_ros.core.storage.reevaluating import stored_measures
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.run_info import RunInfo, library_versions
from pga_me_ros.core.storage.stored_run import REPERTOIRE
from pga_me_ros.core.variation.imported_controllers import Controllers
from pga_me_ros.errors import StorageError
from pga_me_ros.tasks.spec import TaskSpec

LOCK = "run.lock"
FOLDERS = ("logs", "parameters", "experience")

LEAVE_WAIT = 5.0
"""Seconds that an orchestrator gets to exit after it was told to stop."""

ORPHAN_WAIT = 20.0
"""Seconds that the children of a killed orchestrator get to notice and exit: one that is still importing its libraries
notices only afterwards."""


@dataclass(frozen=True)
class RunDirectory:
    """A folder that holds one run, locked for this process and its children.

    Attributes:
        path: The folder.
        run_id: UUID of the run.
        next_generation: First generation that is not committed.
        before: Settings with the rates of the last committed generation.
        settings: Settings with the rates of the next generation.
        notes: What the user should know about how the run is resumed.
        lock: Lock that the children inherit, so that it is free only when all are gone.
        imported: (n, P) float32 controllers that the run starts with instead of random ones.
    """

    path: Path
    run_id: str
    next_generation: int
    before: Settings
    settings: Settings
    notes: tuple[str, ...]
    lock: FileLock
    imported: Controllers

    @property
    def repertoire(self) -> Path:
        """The repertoire file."""
        return self.path / REPERTOIRE


def default_run_dir(settings: Settings) -> Path:
    """Return the default folder, which the same command always finds again.

    It is ``runs/TASK-seedSEED`` for PGA-MAP-Elites and ``runs/TASK-ALGORITHM-seedSEED`` for any other algorithm, but
    for a run of it that an earlier version put into the former.
    """
    task = settings.task.replace(":", ".").rsplit(".", 1)[-1]
    plain = Path("runs") / f"{task}-seed{settings.seed}"
    if settings.algorithm == Settings.algorithm:
        return plain
    own = Path("runs") / f"{task}-{settings.algorithm}-seed{settings.seed}"
    return own if own.exists() or not _is_of(plain, settings.algorithm) else plain


def stored_generations(folder: Path) -> int:
    """Return how many generations the run in a folder has stored; 0 if it has none that can be read."""
    if not (folder / REPERTOIRE).is_file():
        return 0
    with suppress(StorageError), Repertoire.open(folder / REPERTOIRE, read_only=True) as file:
        return file.last_generation + 1
    return 0


def _is_of(folder: Path, algorithm: str) -> bool:
    """Whether a folder holds a run of an algorithm."""
    if not (folder / REPERTOIRE).is_file():
        return False
    with suppress(StorageError), Repertoire.open(folder / REPERTOIRE, read_only=True) as file:
        return Settings.from_stored(file.info.settings).algorithm == algorithm
    return False


def open_run(path: Path, spec: TaskSpec, settings: Settings) -> RunDirectory:
    """Create the folder of a new run, or resume the run that it holds.

    Rates that were changed during the run stay in force, unless other rates are given now than at its first start.

    Args:
        path: The folder.
        spec: Task.
        settings: Settings as given now.

    Raises:
        TaskError: The task lacks what the algorithm needs.
        SettingsError: This machine's memory cannot hold the networks, or `start_from` is malformed.
        StorageError: The folder cannot be written, is in use, or holds another or a damaged run.
    """
    algorithm_of(settings).check_task(spec)
    require_memory(spec, settings)
    for folder in (path, *(path / name for name in FOLDERS)):
        make_folder(folder)
    lock = FileLock(path / LOCK, wait=LEAVE_WAIT, orphans=ORPHAN_WAIT)
    try:
        new = not (path / REPERTOIRE).exists()
        if new:
            _require_no_leftovers(path)
        settings, imported = with_controllers(path, spec, settings, new=new)
        if new:
            _create(path / REPERTOIRE, spec, settings)
        return _resume(path, spec, settings, lock, imported)
    except BaseException:
        lock.release()
        raise


def _require_no_leftovers(path: Path) -> None:
    """Make sure that the folder has no critics or experience of another run."""
    left = sorted([*path.glob("critic-*.ckpt"), *path.glob("experience/experience-*.ckpt")])
    if left:
        raise StorageError(
            f"The folder '{path}' holds '{left[0].relative_to(path)}' of a run whose {REPERTOIRE} is "
            "missing; restore that, or choose another run_dir for a new run."
        )


def _create(path: Path, spec: TaskSpec, settings: Settings) -> None:
    info = RunInfo.of_new_run(spec, settings)
    Repertoire.create(path, info, make_archive(spec, settings)).close()


def _resume(
    path: Path, spec: TaskSpec, settings: Settings, lock: FileLock, imported: Controllers
) -> RunDirectory:
    with Repertoire.open(path / REPERTOIRE, read_only=True) as repertoire:
        info = repertoire.info
        info.require(settings, spec.to_json())
        generations = repertoire.generations()
    rates = [generation.rates for generation in generations]
    notes = [
        f"library versions differ from the run's start ({d}): results may not be bit for bit the same"
        for d in info.version_differences(library_versions())
    ]
    last = rates[-1] if rates else settings.rates
    started_with = Settings.from_stored(info.settings)
    if settings.rates == started_with.rates and settings.with_rates(last) != settings:
        notes.append("the rates that were set while the run was under way stay in force")
        now = settings.with_rates(last)
    else:
        now = settings
    before = settings.with_rates(last)
    if len(rates) < settings.generations:
        notes += require_sound_state(path, rates, before, now)
    measured = stored_measures(path / REPERTOIRE, info.run_id, spec.descriptor_dim)
    MetricsFile(path / METRICS_FILE).rebuild(generations, measured)
    return RunDirectory(path, info.run_id, len(rates), before, now, tuple(notes), lock, imported)
