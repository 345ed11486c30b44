"""The simulators that the live page keeps open."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.explorer import recorder as module
from pga_me_ros.explorer.motion import EpisodeStart
from pga_me_ros.explorer.recorder import KEPT, Recorder
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import make_task


def closing(task: Task, noted: Callable[[], None]) -> Task:
    """Return a task that notes when it is closed."""
    close = task.close

    def noted_close() -> None:
        noted()
        close()

    task.close = noted_close  # type: ignore[method-assign]
    return task


def test_the_sound_robot_and_the_worlds_used_last_stay_open(
    hopper_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []

    def make(task: str, randomization: str, damage: str) -> Task:
        opened.append(randomization)
        return closing(make_task(task, randomization, damage), lambda: opened.remove(randomization))

    monkeypatch.setattr(module, "make_task", make)
    run = StoredRun.load(hopper_run)
    recorder = Recorder(run.settings, run.behavior)
    cell = min(run.archive.elites(), key=lambda elite: elite.steps).cell
    worlds = [f"mass {1 + k}.0" for k in range(KEPT + 1)]
    for world in (*worlds[:-1], worlds[0], worlds[-1]):
        recorder.motion(cell, EpisodeStart(1, world))
    assert opened == ["", worlds[0], *worlds[2:]]
    recorder.motion(cell, EpisodeStart())
    assert len(opened) == 1 + KEPT
    recorder.close()
    assert opened == []
