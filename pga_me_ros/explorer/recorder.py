"""Records the motion of a run's gaits; a run whose robot cannot be shown has a reason instead."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any

from pga_me_ros.core.archive.spread import spread_cells
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import PgaError
from pga_me_ros.explorer.motion import EpisodeStart, describe_motion, recorded
from pga_me_ros.explorer.robot_model import describe_model
from pga_me_ros.explorer.source import require_shown
from pga_me_ros.player.gait import Gait
from pga_me_ros.player.reader import reader_of
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import make_task

KEPT = 3
"""Other worlds and damaged robots that stay open, those used last; each takes some 30 MB."""


class Recorder:
    """Simulated robots of one run, each started when it is needed.

    Args:
        settings: Settings of the run.
        gait: Returns the gait of a cell.

    Attributes:
        missing: Why the robot cannot be shown, empty if it can.
        model: The robot, fit for JSON; None if it cannot be shown.
    """

    def __init__(self, settings: Settings, gait: Callable[[int], Gait]) -> None:
        self._settings = settings
        self._gait = gait
        self._tasks: dict[tuple[str, str], Task] = {}  # the one used last comes last
        self.missing = ""
        self.model: dict[str, Any] | None = None
        try:
            self.model = describe_model(reader_of(self._task()).model)
        except PgaError as error:
            self.missing = str(error)
        except ImportError as error:
            self.missing = f"the simulator of task '{settings.task}' is missing ({error})"

    def motion(
        self, cell: int, start: EpisodeStart, evaluation: int | None = None
    ) -> dict[str, Any]:
        """Return an episode of the gait of a cell, see `describe_motion`.

        Args:
            cell: The cell.
            start: Where the episode begins.
            evaluation: Id of the evaluation of the gait that is meant; None for the one that is there.

        Raises:
            PgaError: There is no such gait, it is another one, its robot cannot be shown, or the task cannot be
                randomized or damaged so.
        """
        gait = self._gait(cell)
        if evaluation is not None:
            require_shown(gait, evaluation)
        task = self._task(start.randomization, start.damage)
        motion = describe_motion(
            recorded(task, self._settings, gait, start), task.spec, gait, start
        )
        return motion | {"lost": self._lost(task) if start.damage else []}

    def close(self) -> None:
        """Stop the simulators."""
        for task in self._tasks.values():
            _close(task)
        self._tasks.clear()

    def _lost(self, damaged: Task) -> list[str]:
        """Return the links that a damaged robot has lost: those that show nothing, unlike those of the sound one."""
        assert self.model is not None, "it was just recorded"
        left = {link.name for link in reader_of(damaged).model.links if link.shapes}
        sound = {link["name"] for link in self.model["links"] if link["shapes"]}
        return sorted(sound - left)

    def _task(self, randomization: str = "", damage: str = "") -> Task:
        """Return a simulator; the sound one stays open, of the others the last few."""
        sound = self._settings.randomization, ""
        wanted = randomization or self._settings.randomization, damage
        task = self._tasks.pop(wanted, None)
        if task is None:
            task = make_task(self._settings.task, *wanted)
        self._tasks[wanted] = task
        for other in [key for key in self._tasks if key != sound][:-KEPT]:
            _close(self._tasks.pop(other))
        return task


def _close(task: Task) -> None:
    with suppress(Exception):  # a user's class may raise anything
        task.close()


def chosen_cells(run: StoredRun, count: int) -> list[int]:
    """Return cells whose gaits differ most, the fittest among them, at most so many."""
    choices = run.choices()
    return spread_cells(choices.elites, choices.cells(), count) if count else []


def all_motions(
    recorder: Recorder, cells: Iterable[int], starts: tuple[EpisodeStart, ...]
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield cells, each with its motions by the name of their start."""
    for cell in cells:
        yield cell, {start.key: recorder.motion(cell, start) for start in starts}
