"""Compiled arithmetic gives the same bits as its Python code."""

from __future__ import annotations

import os
import subprocess
import sys

PROGRAM = """
import hashlib

import torch

from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.gradients.value_ascent import climb
from pga_me_ros.tasks.registry import load_task

settings = Settings(
    random_init=20, batch_size=20, n_evo=10, evaluations=60, n_crit=12, cells=64, cvt_samples=2000
)
task = load_task(settings.task)()
search = Search(task.spec, settings)
for _ in range(3):
    search.run_generation(task)
print(isinstance(climb, torch.jit.ScriptFunction))
print(search.archive.digest())
for array in search.learner.state().values():
    print(hashlib.sha256(array.tobytes()).hexdigest())
"""


def outcome(**environment: str) -> list[str]:
    """Return whether functions were compiled, and digests of a short search's repertoire and critics."""
    run = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return run.stdout.splitlines()


def test_compiled_arithmetic_has_the_bits_of_its_python_code() -> None:
    compiled, python = outcome(PYTORCH_JIT="1"), outcome(PYTORCH_JIT="0")
    assert (compiled[0], python[0]) == ("True", "False")
    assert compiled[1:] == python[1:]
