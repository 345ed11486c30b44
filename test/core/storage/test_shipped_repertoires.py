"""The repertoires that come with the package: complete, small, and as good as they say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pga_me_ros import StoredRun, make_task
from pga_me_ros.core.storage.shipped import shipped
from pga_me_ros.tasks.rollout import rollout

FOLDERS = list(shipped().values())
MOST_BYTES = 10_000_000


@pytest.fixture(params=FOLDERS, ids=lambda folder: folder.name)
def folder(request: pytest.FixtureRequest) -> Path:
    path: Path = request.param
    return path


def test_there_is_one_for_each_built_in_robot() -> None:
    robots = {"qd_hopper", "qd_walker", "qd_half_cheetah", "qd_ant"}
    assert robots <= {folder.name for folder in FOLDERS}


def test_it_is_small_and_every_behavior_was_tried_again(folder: Path) -> None:
    assert sum(file.stat().st_size for file in folder.iterdir()) < MOST_BYTES
    run = StoredRun.load(f"zoo/{folder.name}")
    behaviors = [run.choose(cell=int(cell)) for cell in np.flatnonzero(run.archive.filled)]
    assert 64 <= len(behaviors) <= 128
    assert all(behavior.by_mean and behavior.repeats >= 20 for behavior in behaviors)
    assert f"{len(behaviors)} behaviors of {run.settings.task}" in (folder / "card.md").read_text()


def test_its_best_behavior_achieves_from_new_starts_what_it_promises(folder: Path) -> None:
    run = StoredRun.load(f"zoo/{folder.name}")
    best = run.choose(max_fall_share=0.05)
    episodes = [run.rollout(best, seed=seed) for seed in range(1001, 1006)]
    fitness = float(np.median([episode.fitness for episode in episodes]))
    assert fitness >= 0.9 * best.promised_fitness
    achieved = np.median([episode.descriptor for episode in episodes], axis=0)
    assert np.linalg.norm((achieved - best.promised_descriptor) / run.archive.extent) <= 0.05


def test_its_actor_knows_the_best_gait(folder: Path) -> None:
    run = StoredRun.load(f"zoo/{folder.name}")
    best = run.choose(max_fall_share=0.05)
    controller = run.actor().at(best.promised_descriptor)
    task = make_task(run.settings.task)
    episodes = [
        rollout(task, controller, np.random.default_rng(seed)) for seed in (1001, 1002, 1003)
    ]
    task.close()
    assert np.median([episode.fitness for episode in episodes]) >= 0.75 * best.promised_fitness
    assert not any(episode.terminated for episode in episodes)
