"""The example of a user's own robot follows the protocol, and a repertoire of different gaits grows for it."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.check import check_task
from pga_me_ros.tasks.registry import load_task

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "my_robot"
NAME = "my_task:Crawler"


@pytest.fixture
def crawler(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    monkeypatch.syspath_prepend(FOLDER)
    yield load_task(NAME)
    sys.modules.pop("my_task", None)


def test_it_follows_the_protocol(crawler: Any) -> None:
    assert check_task(crawler) == []


def test_its_commands_name_it() -> None:
    text = (FOLDER / "my_task.py").read_text()
    assert re.findall(r"tasks\.check (\S+)|task:=(\S+)", text) == [(NAME, ""), ("", NAME)]


def test_a_repertoire_of_different_gaits_grows(crawler: Any) -> None:
    settings = Settings(
        task=NAME,
        random_init=20,
        batch_size=20,
        n_evo=10,
        n_crit=10,
        n_grad=2,
        transition_batch=64,
        controller_hidden=(16,),
        critic_hidden=(16,),
        cvt_samples=2000,
    )
    search, task = Search(crawler.spec, settings), crawler()
    metrics = [search.run_generation(task) for _ in range(10)]
    task.close()
    assert metrics[-1].coverage > 1.2 * metrics[0].coverage
    assert metrics[-1].max_fitness > metrics[0].max_fitness
    spread = np.ptp([elite.descriptor for elite in search.archive.elites()], axis=0)
    assert (
        spread > 0.25 * np.subtract(crawler.spec.descriptor_high, crawler.spec.descriptor_low)
    ).all()
