"""The long proof that a run survives the death of its processes: kills and suspends them at random moments.

Run: `make chaos`, or `.venv/bin/python bench/chaos.py [--seed 0] [--kills 24] [--task qd_walker] [--part NAME]`; the
last line is JSON, the exit code 0 only if every part ended with the repertoire of `core.search`, bit for bit.

- `children`: children are killed with SIGKILL, each kind in turn in a random order, at random moments of generations
  with PG variation; often while others are still being restarted.
- `everything`: the orchestrator is killed, alone (its children must exit by themselves) or together with all its
  children, while it starts or works; the same command resumes.
- `stopped`: children are suspended with SIGSTOP for longer than it takes to be missed, then continued.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from _chaos_run import ChaosError, ChaosRun
from domain_coordinator import domain_id

from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.registry import load_task

NAMES = ("evaluator_0", "evaluator_1", "critic_trainer", "variation", "archive_manager")

BATCH = 20
INIT_GENERATIONS = 2
QUIET_GENERATIONS = 2
"""Generations at the end in which the run is left alone."""

KILLS_PER_GENERATION = 1.6
"""More than one, so that a node is also killed while others are being restarted."""

WITHIN = 1.5
"""Seconds after the end of a generation within which something is killed: a few generations' worth."""

START = 4.0
"""Seconds after the start of a run within which it is killed if that should happen during the start."""

PER_RESUME = 3
"""Generations per kill of the orchestrator: more than the run does on average before it."""

PER_STOP = 8
"""Generations per stop on average: many if an evaluator is suspended and the other continues, few otherwise."""

STOPS = {"evaluator_0": 7.0, "critic_trainer": 12.0, "variation": 12.0, "archive_manager": 12.0}
"""Seconds that children are suspended: an evaluator is missed after 5, a request is repeated after 10."""


@dataclass
class Record:
    """What was done to a run, and with what effect.

    Attributes:
        rows: One line per action, for the table.
        hits: How often each node was hit.
        orphans: Seconds that children outlived their orchestrator.
    """

    rows: list[str] = field(default_factory=list)
    hits: Counter[str] = field(default_factory=Counter)
    orphans: list[float] = field(default_factory=list)

    def note(self, run: ChaosRun, what: str, name: str, more: str = "") -> None:
        """Record and print one action."""
        self.hits[name] += 1
        self.rows.append(f"{len(self.rows) + 1:3} {what:5} {name:16} {run.generations:3}  {more}")
        print(self.rows[-1], flush=True)


def settings_of(task: str, seed: int, generations: int) -> Settings:
    """Return the settings of the runs: small networks, but all parts of a full run, and generations of a second."""
    return Settings(
        task=task,
        seed=seed,
        evaluations=generations * BATCH,
        random_init=INIT_GENERATIONS * BATCH,
        batch_size=BATCH,
        n_evo=8,
        n_crit=1000,
        transition_batch=128,
        cells=256,
        cvt_samples=5000,
        controller_hidden=(32, 32),
        critic_hidden=(64, 64),
        replay_size=20_000,
    )


def search_digests(settings: Settings) -> list[str]:
    """Return the digests of the same run in this process, after each of its generations."""
    task = load_task(settings.task)()
    search = Search(task.spec, settings)
    digests = []
    while search.generation < settings.generations:
        search.run_generation(task)
        digests.append(search.archive.digest())
    task.close()
    return digests


def kill_children(run: ChaosRun, rng: np.random.Generator, deeds: int, record: Record) -> None:
    """Kill children at random moments."""
    run.start()
    victims: list[str] = []
    while len(victims) < deeds:
        victims += rng.permutation(NAMES).tolist()
    for i, name in enumerate(victims[:deeds]):
        run.wait_for_generation(INIT_GENERATIONS + int(i / KILLS_PER_GENERATION))
        wait = rng.uniform(0.0, WITHIN)
        time.sleep(wait)
        pid = run.send(name, signal.SIGKILL)
        record.note(run, "kill", name, f"process {pid}, {wait:.2f} s after")


def kill_everything(run: ChaosRun, rng: np.random.Generator, deeds: int, record: Record) -> None:
    """Kill the orchestrator at random moments of its start and its work, and resume with the same command."""
    run.start()
    for i in range(deeds):
        done = run.generations
        starting = i % 3 == 0  # the first time while it makes its folder, or shortly after
        if not starting:
            run.wait_for_generation(max(INIT_GENERATIONS, done + 1))
        time.sleep(rng.uniform(0.0, START if starting else WITHIN))
        together = i % 2 == 1
        alive = len(run.children())
        record.orphans.append(run.kill_orchestrator(with_children=together))
        more = f"{alive} children gone after {record.orphans[-1]:.2f} s"
        record.note(run, "kill", "everything" if together else "orchestrator", more)
        run.start()


def stop_children(run: ChaosRun, rng: np.random.Generator, deeds: int, record: Record) -> None:
    """Suspend children for a while, as swapping or a debugger does."""
    run.start()
    for i in range(deeds):
        name = list(STOPS)[i % len(STOPS)]
        run.wait_for_generation(max(INIT_GENERATIONS, run.generations + 1))
        time.sleep(rng.uniform(0.0, WITHIN))
        pid = run.send(name, signal.SIGSTOP)
        time.sleep(STOPS[name])
        if run.children().get(name) != pid:
            raise ChaosError(f"did not wait for {name}, which was suspended:\n{run.output}")
        os.kill(pid, signal.SIGCONT)
        record.note(run, "stop", name, f"process {pid}, for {STOPS[name]:.0f} s")


def generations_of(part: str, deeds: int) -> int:
    """Return the number of generations of a part, so that its last action comes before the end."""
    if part == "stopped":
        return INIT_GENERATIONS + PER_STOP * deeds
    busy = int(deeds / KILLS_PER_GENERATION) if part == "children" else PER_RESUME * deeds
    return INIT_GENERATIONS + busy + QUIET_GENERATIONS


Deeds = Callable[[ChaosRun, np.random.Generator, int, Record], None]

PARTS: dict[str, Deeds] = {
    "children": kill_children,
    "everything": kill_everything,
    "stopped": stop_children,
}


def carry_out(
    part: str, deeds: int, settings: Settings, folder: Path, digests: list[str], domain: int
) -> dict[str, Any]:
    """Carry out one part, check its outcome and return its figures.

    Raises:
        ChaosError: The run failed, left something behind, or ended with another repertoire.
    """
    generations = generations_of(part, deeds)
    settings = settings.replace(evaluations=generations * BATCH)
    print(f"\n{part}: {generations} generations\n  # what  node             gen")
    usual = Settings().to_dict()
    parameters = {n: value for n, value in settings.to_dict().items() if value != usual[n]}
    parameters |= {"evaluators": 2, "serve": False, "reevaluations": 0}
    run = ChaosRun(folder / part, parameters, domain)
    record, began = Record(), time.monotonic()
    rng = np.random.default_rng((settings.seed, list(PARTS).index(part)))
    try:
        PARTS[part](run, rng, deeds, record)
        digest = run.finish()
    except ChaosError as error:
        raise ChaosError(f"{part} {error}") from None
    finally:
        run.end()
    seconds = round(time.monotonic() - began)
    print(run.output.strip().splitlines()[-1])
    if digest != digests[generations - 1]:
        raise ChaosError(f"{part} ended with {digest}, core.search with {digests[generations - 1]}")
    print(f"{seconds} s; ended with {digest}, as core.search does", flush=True)
    return {
        "deeds": sum(record.hits.values()),
        "hits": dict(sorted(record.hits.items())),
        "generations": generations,
        "orphans_gone_s": round(max(record.orphans, default=0.0), 2),
        "same_repertoire": True,
        "seconds": seconds,
    }


def main() -> int:
    """Carry out all parts, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0, help="of the run and of the moments")
    parser.add_argument("--kills", type=int, default=24, help="of children")
    parser.add_argument("--resumes", type=int, default=10, help="kills of the orchestrator")
    parser.add_argument("--stops", type=int, default=4, help="of children, with SIGSTOP")
    parser.add_argument("--task", default="qd_walker")
    parser.add_argument("--part", choices=PARTS, help="one part only")
    arguments = parser.parse_args()
    deeds = dict(zip(PARTS, (arguments.kills, arguments.resumes, arguments.stops), strict=True))
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that no run is left behind
    if arguments.part:
        deeds = {arguments.part: deeds[arguments.part]}
    longest = max(generations_of(part, n) for part, n in deeds.items())
    settings = settings_of(arguments.task, arguments.seed, longest)
    digests = search_digests(settings)
    folder = Path(tempfile.mkdtemp(prefix="chaos-"))
    with domain_id() as domain:
        try:
            parts = {
                part: carry_out(part, n, settings, folder, digests, domain)
                for part, n in deeds.items()
            }
        except ChaosError as error:
            print(f"FAILED: {error}\nsee {folder}", file=sys.stderr)
            return 1
    shutil.rmtree(folder)
    run = {"task": arguments.task, "seed": arguments.seed}
    print(json.dumps({"bench": "chaos", **run, "parts": parts}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
