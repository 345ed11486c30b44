"""The cost of a new episode: our reset compared with stock pybullet_envs and with our own steps.

Run: `.venv/bin/python bench/reset.py [--rounds 15]`; the last line is JSON. Every figure is a
ratio of things measured in turn (A B A B ...) in this process, the median over rounds. Each reset
follows some steps, as it does in a run.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from _measure import tabulated
from rollout import STOCK, generator, stock_reset

from pga_me_ros.tasks.registry import load_task

EPISODES = 20
STEPS = 10


def time_ours(task: Any) -> tuple[float, float]:
    """Return the mean time of a reset and of a step, s."""
    reset = step = 0.0
    action = np.full(task.spec.action_dim, 0.3, np.float32)
    for seed in range(EPISODES):
        rng = generator(seed)
        start = time.perf_counter()
        task.reset(rng)
        middle = time.perf_counter()
        for _ in range(STEPS):
            task.step(action)
        step += time.perf_counter() - middle
        reset += middle - start
    return reset / EPISODES, step / (EPISODES * STEPS)


def time_stock_reset(environment: Any) -> float:
    total = 0.0
    action = np.full(environment.action_space.shape, 0.3, np.float32)
    for seed in range(EPISODES):
        start = time.perf_counter()
        stock_reset(environment, seed)
        total += time.perf_counter() - start
        for _ in range(STEPS):
            environment.step(action)
    return total / EPISODES


def measure_task(name: str, rounds: int) -> dict[str, list[float]]:
    """Return the ratios of each round."""
    task, environment = load_task(name)(), STOCK[name]()
    stock_reset(environment, 0)
    ratios: dict[str, list[float]] = {"reset_vs_stock": [], "reset_in_steps": []}
    for _ in range(rounds):
        reset, step = time_ours(task)
        ratios["reset_vs_stock"].append(time_stock_reset(environment) / reset)
        ratios["reset_in_steps"].append(reset / step)
    task.close()
    environment.close()
    return ratios


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    rounds = parser.parse_args().rounds
    figures = tabulated(STOCK, lambda name: measure_task(name, rounds))
    print(json.dumps({"bench": "reset", "figures": figures}))


if __name__ == "__main__":
    main()
