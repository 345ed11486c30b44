"""Fixtures shared by tests of several folders."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.settings.rules import of_other_archives
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.tasks.registry import make_task, task_spec

# Tests start hundreds of processes, each of which would otherwise compile the package again.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

LONG = ("test/packaging/test_workspace.py", "test/graph/", "test/old_runs/")
"""Tests of builds and processes take the longest; if they started last, one worker would be left alone with them."""

TOGETHER = ("test/explorer/",)
"""Folders whose tests share what takes long to make, such as a browser: one worker takes each."""

SMALL = {
    "task": "qd_hopper",
    "seed": 5,
    "evaluations": 20,
    "random_init": 20,
    "batch_size": 10,
    "n_evo": 10,
    "cells": 30,
    "cvt_samples": 1000,
    "controller_hidden": (16, 8),
}
"""Settings of a run without gradients that takes a second to simulate."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest tests first."""
    items.sort(key=lambda item: [not item.nodeid.startswith(start) for start in LONG])


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give the folders of `TOGETHER` to one worker each; the others go file by file, as ``--dist loadscope`` has it."""
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            folder = next((start for start in TOGETHER if nodeid.startswith(start)), None)
            return folder or str(super()._split_scope(nodeid))

    return Together(config, log) if config.getvalue("dist") == "loadscope" else None


def store_run(folder: Path, **settings: object) -> Path:
    """Carry out a run in this process and store it; return its folder. None omits a setting."""
    from pga_me_ros.core.search import Search

    unused = of_other_archives(str(settings.get("archive", Settings.archive)))
    small = {name: value for name, value in SMALL.items() if name not in unused}
    given = {name: value for name, value in {**small, **settings}.items() if value is not None}
    asked = Settings.from_mapping(given)
    directory = open_run(folder, task_spec(asked.task), asked)
    directory.lock.release()
    task = make_task(asked.task)
    search = Search(task.spec, asked)
    rates = {name: getattr(asked, name) for name in RATES}
    with Repertoire.open(directory.repertoire) as repertoire:
        for generation in range(asked.generations):
            metrics = search.run_generation(task)
            repertoire.commit(generation, list(search.archive.elites()), metrics, rates)
    task.close()
    return folder


@pytest.fixture(autouse=True)
def same_environment() -> Iterator[None]:
    """Undo a test's changes to this process's environment."""
    before = dict(os.environ)
    yield
    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Return a headless Chromium, driven by Playwright, which can run only once in a process."""
    from browsing import running_browser

    with running_browser() as running:
        yield running


@pytest.fixture(scope="session")
def hopper_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a small finished run; read it, or copy it."""
    return store_run(tmp_path_factory.mktemp("hopper") / "run")


@pytest.fixture(scope="session")
def dcrl_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a small finished run of DCRL-MAP-Elites, with its actor; read it, or copy it."""
    from pga_me_ros import Search, save_run

    learning = {"n_crit": 20, "n_grad": 2, "transition_batch": 32, "critic_hidden": (16,)}
    small = {**SMALL, **learning, "algorithm": "dcrl_map_elites", "random_init": 10, "n_evo": 5}
    settings = Settings.from_mapping({**small, "evaluations": 30})
    task = make_task(settings.task)
    search = Search(task.spec, settings)
    for _ in range(settings.generations):
        search.run_generation(task)
    task.close()
    return save_run(tmp_path_factory.mktemp("dcrl") / "run", search).file.parent


@pytest.fixture(scope="session")
def new_run(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Return a function that carries out and stores another run, with some settings changed."""

    def new(**settings: object) -> Path:
        return store_run(tmp_path_factory.mktemp("run") / "run", **settings)

    return new
