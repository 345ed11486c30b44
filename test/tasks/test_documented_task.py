"""The example in docs/tasks.md is complete, valid, and good enough to grow a repertoire for."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from pga_me_ros.core.operators import Operator
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.registry import load_task

ROOT = Path(__file__).resolve().parents[2]
NAME = "cart:Cart"
DOCUMENT = (ROOT / "docs" / "tasks.md").read_text()


@pytest.fixture
def cart(tmp_path, monkeypatch):
    """Return the documented class, loaded by name from a file."""
    (code,) = re.findall(r"```python\n(.*?)```", DOCUMENT, re.DOTALL)
    (tmp_path / "cart.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    yield load_task(NAME)
    sys.modules.pop("cart", None)


def test_the_documented_check_finds_nothing(cart, tmp_path):
    (command,) = re.findall(r"```\npython (-m pga_me_ros\.tasks\.check .*?)\n```", DOCUMENT)
    result = subprocess.run(
        [sys.executable, *command.split()],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stdout) == (0, f"{NAME}: follows the task protocol\n")


def test_a_repertoire_grows_for_it(cart):
    settings = Settings(
        task=NAME,
        random_init=40,
        batch_size=20,
        n_evo=10,
        n_crit=20,
        n_grad=5,
        transition_batch=64,
        controller_hidden=(16,),
        critic_hidden=(16,),
        cvt_samples=2000,
    )
    search, task = Search(cart.spec, settings), cart()
    metrics = [search.run_generation(task) for _ in range(6)]
    made = dict(zip(Operator, metrics[-1].offspring, strict=True))
    assert +Counter(made) == {Operator.GA: 10, Operator.PG: 9, Operator.GREEDY: 1}
    assert metrics[-1].coverage > metrics[1].coverage > 0
    assert metrics[-1].max_fitness > metrics[1].max_fitness


def test_the_documented_commands_name_the_documented_class():
    assert re.findall(r"task:=(\S+)", DOCUMENT) == [NAME, NAME]
