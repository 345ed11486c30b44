"""How long a run of the paper's size takes on machines with any number of cores: a model with costs measured here.

Run: `.venv/bin/python bench/paper_scale.py [--rounds 5] [--evaluations 1000000] [--steps 1000]`; the last line is JSON.
Measured in turn in this process, medians over the rounds: a control step with its controller and the record of it, the
critics' training of one generation with one and with two threads, and its PG variation. Batches, networks and steps
are those of Table 1.

A generation takes the longest of three times: all its work, spread over the cores; the critics' training with two
threads, as there is no work for a third; and what has to happen in sequence between two snapshots, PG variation and
the episodes of its offspring. `--messages` is what else a generation costs, in core seconds: see `bench/graph.py`.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from _measure import seconds

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.learning.critic_learner import CriticLearner
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import CRITIC
from pga_me_ros.core.variation.policy_gradient import pg_states, pg_variation
from pga_me_ros.core.variation.random_controllers import random_controllers
from pga_me_ros.tasks.registry import load_task
from pga_me_ros.tasks.rollout import Episode, rollout

TASKS = ("qd_walker", "qd_half_cheetah", "qd_ant", "qd_hopper")
CORES = (2, 16, 64)
EPISODES = 20


@dataclass(frozen=True)
class Costs:
    """What the parts of a generation cost on one core, seconds.

    Attributes:
        step: One control step of one robot.
        training: The critics' training of one generation.
        training_by_two: Its time with two threads on a core each.
        pg: PG variation of one generation.
    """

    step: float
    training: float
    training_by_two: float
    pg: float


def measure(task_name: str, rounds: int) -> Costs:
    """Measure the parts of a generation in turn."""
    task = load_task(task_name)()
    settings = Settings(task=task_name, replay_size=100_000)
    shape = controller_shape(task.spec, settings)
    parents = random_controllers(settings, shape, 0, 0, settings.batch_size)
    controllers = [MlpController(shape, p) for p in parents[:EPISODES]]
    learner, by_two = (CriticLearner(task.spec, settings, workers) for workers in (1, 2))

    def simulate() -> list[Episode]:
        episodes = [rollout(task, c, evaluation_rng(0, k)) for k, c in enumerate(controllers)]
        learner.add(learner.newest + 1, episodes)
        return episodes

    episodes = simulate()
    steps = sum(e.length for e in episodes)
    by_two.add(0, episodes)
    snapshot, _ = (one.train(settings.replace(n_crit=20), 0) for one in (learner, by_two))
    critic_shape, critic = snapshot.network(CRITIC)
    n_pg = settings.batch_size - 1 - settings.n_evo

    def vary() -> None:
        pg_variation(
            parents[:n_pg],
            critic,
            pg_states(snapshot, 0, n_pg),
            settings.pg_learning_rate,
            shape,
            critic_shape,
            threads=1,
        )

    vary()
    rows = [
        (
            seconds(simulate) / steps,
            seconds(lambda g=generation: learner.train(settings, g)),  # type: ignore[misc]
            seconds(lambda g=generation: by_two.train(settings, g)),  # type: ignore[misc]
            seconds(vary),
        )
        for generation in range(1, rounds + 1)
    ]
    task.close()
    return Costs(*(statistics.median(column) for column in zip(*rows, strict=True)))


def generation_seconds(costs: Costs, steps: int, cores: int, messages: float) -> float:
    """Return the time of a generation according to the model.

    Args:
        costs: Costs of its parts.
        steps: Steps of each episode.
        cores: Cores of the machine.
        messages: Other costs, core seconds.
    """
    s = Settings()
    episode = steps * costs.step
    work = s.batch_size * episode + costs.training + costs.pg + messages
    n_pg = s.batch_size - s.n_evo
    between_snapshots = costs.pg / min(cores, n_pg) + episode * math.ceil(n_pg / cores)
    return max(work / cores, costs.training_by_two, between_snapshots)


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--evaluations", type=int, default=1_000_000)
    parser.add_argument("--steps", type=int, default=1000, help="of each episode")
    parser.add_argument("--messages", type=float, default=0.6, help="core seconds per generation")
    arguments = parser.parse_args()
    generations = arguments.evaluations / Settings().batch_size
    figures: dict[str, dict[str, float]] = {}
    head = "  ".join(f"{n:3} cores" for n in CORES)
    print(f"{'task':16} step    training  PG      hours on {head}")
    for name in TASKS:
        costs = measure(name, arguments.rounds)
        hours = [
            generations * generation_seconds(costs, arguments.steps, n, arguments.messages) / 3600
            for n in CORES
        ]
        figures[name] = {f"hours_on_{n}": round(h, 1) for n, h in zip(CORES, hours, strict=True)}
        figures[name] |= {
            "training_in_steps": round(costs.training / costs.step),
            "pg_in_steps": round(costs.pg / costs.step),
        }
        print(
            f"{name:16} {costs.step * 1e3:.3f} ms {costs.training:.2f} s   {costs.pg:.2f} s           "
            + "  ".join(f"{h:9.1f}" for h in hours),
            flush=True,
        )
    print(json.dumps({"bench": "paper_scale", "figures": figures}))


if __name__ == "__main__":
    main()
