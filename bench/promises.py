"""Whether a repertoire keeps its promises: asks for descriptors, and runs the answers from starts never seen.

Run: `.venv/bin/python bench/promises.py zoo/qd_hopper [--asked 200] [--starts 10] [--max-fall-share 0.05] [--actor]`;
the last line is JSON. The descriptors are drawn uniformly from the covered region: from the box around what the
behaviors promise, less what is farther than `NEAR` from all of them. The promise is what the answer says: the mean of
the behavior's re-evaluations where it has some. Distances are in shares of the descriptor's range.

With ``--actor``, the actor of a run of DCRL-MAP-Elites gets the descriptors, and what it achieves stands next to the
same promises.
"""

from __future__ import annotations

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in evaluators

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.core.archive.choosing import Demands, Judging
from pga_me_ros.core.networks.conditioned import ConditionedActor
from pga_me_ros.library import StoredRun
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import rollout

NEAR = 0.05
"""Greatest distance of a descriptor that is asked for from one that is promised, in shares of the range."""


@dataclass(frozen=True)
class Answer:
    """What was promised to a descriptor, and what was achieved.

    Attributes:
        promised_fitness: As the answer says.
        promised_falls: Share of falls that the answer says.
        asked_to_promised: Distance between the descriptors.
        missed_by: Distance of the achieved descriptor from the promised one, for an actor from that asked for; one per
            start.
        fitness: Achieved, one per start.
        falls: Number of episodes that ended in a fall.
    """

    promised_fitness: float
    promised_falls: float
    asked_to_promised: float
    missed_by: list[float]
    fitness: list[float]
    falls: int


@cache
def loaded(name: str) -> StoredRun:
    """Read a run, once in each process."""
    return StoredRun.load(name)


def asked_for(
    run: StoredRun, demands: Demands, count: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw descriptors from the covered region: (count, D) float64."""
    low, high = run.spec.descriptor_low, run.spec.descriptor_high
    choices = run.choices(demands)
    known = [choices.elites.descriptors[cell] for cell in choices.cells()]
    shares = (np.array(known) - low) / (np.asarray(high) - low)
    drawn: list[NDArray[np.float64]] = []
    while len(drawn) < count:
        share = rng.uniform(shares.min(axis=0), shares.max(axis=0))
        if np.linalg.norm(shares - share, axis=1).min() <= NEAR:
            drawn.append(low + share * (np.asarray(high) - low))
    return np.array(drawn)


@cache
def actor_of(name: str) -> ConditionedActor:
    """Read the actor of a run, once in each process."""
    return loaded(name).actor()


def answer(
    name: str, max_fall_share: float | None, with_actor: bool, descriptor: list[float], seeds: range
) -> Answer:
    """Ask for a descriptor, and run the behavior, or the actor, from as many starts as there are seeds."""
    run = loaded(name)
    extent = np.subtract(run.spec.descriptor_high, run.spec.descriptor_low)
    gait = run.choose(descriptor=descriptor, max_fall_share=max_fall_share)
    controller, goal = gait.controller, gait.promised_descriptor
    if with_actor:
        controller, goal = actor_of(name).at(descriptor), np.array(descriptor)
    task = make_task(run.settings.task, run.settings.randomization)
    try:
        episodes = [rollout(task, controller, np.random.default_rng(seed)) for seed in seeds]
    finally:
        task.close()
    return Answer(
        gait.promised_fitness,
        gait.fall_share if gait.by_mean else float("nan"),
        gait.distance,
        [float(np.linalg.norm((e.descriptor - goal) / extent)) for e in episodes],
        [e.fitness for e in episodes],
        sum(e.terminated for e in episodes),
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run")
    parser.add_argument("--asked", type=int, default=200)
    parser.add_argument("--starts", type=int, default=10)
    parser.add_argument("--max-fall-share", type=float)
    parser.add_argument(
        "--actor", action="store_true", help="run the actor in place of the answers' behaviors"
    )
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    if asked.actor:
        actor_of(asked.run)  # if it has none, it ends here
    demands = Demands(
        Judging.of(single=False),
        max_fall_share=float("inf") if asked.max_fall_share is None else asked.max_fall_share,
    )
    rng = np.random.default_rng(asked.seed)
    descriptors = asked_for(StoredRun.load(asked.run), demands, asked.asked, rng)
    first = 1_000_000 * (asked.seed + 1)
    seeds = [
        range(first + k * asked.starts, first + (k + 1) * asked.starts) for k in range(asked.asked)
    ]
    with ProcessPoolExecutor(os.cpu_count(), mp_context=get_context("spawn")) as pool:
        answers = list(
            pool.map(
                answer,
                [asked.run] * asked.asked,
                [asked.max_fall_share] * asked.asked,
                [asked.actor] * asked.asked,
                descriptors.tolist(),
                seeds,
            )
        )
    goal = "asked" if asked.actor else "promised"  # an actor promises nothing
    shares = [f / a.promised_fitness for a in answers for f in a.fitness]
    figures = {
        "behaviors asked for": asked.asked,
        "starts of each": asked.starts,
        "median distance from asked to promised descriptor": np.median(
            [a.asked_to_promised for a in answers]
        ),
        f"median distance from {goal} to achieved descriptor": np.median(
            [a.missed_by for a in answers]
        ),
        "median promised fitness": np.median([a.promised_fitness for a in answers]),
        "median achieved fitness": np.median([a.fitness for a in answers]),
        "median share of the promised fitness that was achieved": np.median(shares),
        "promised share of falls": np.mean([a.promised_falls for a in answers]),
        "share of falls": sum(a.falls for a in answers) / (asked.asked * asked.starts),
    }
    for name, value in figures.items():
        print(f"{name:58} {value:10.3f}")
    print(
        json.dumps(
            {
                "bench": "promises",
                "run": asked.run,
                "actor": asked.actor,
                "figures": {k: float(v) for k, v in figures.items()},
            }
        )
    )


if __name__ == "__main__":
    main()
