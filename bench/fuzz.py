"""The long proof that nobody can harm a run with what they send to it: a fuzzer in the ROS domain of a run.

Bad values for every parameter of every node come first: each must be refused in one line that names the parameter.
During the run, a subscriber looks at every topic that it publishes.

Run: `make fuzz`, or `.venv/bin/python bench/fuzz.py [--cases 10000] [--seed 0]`; the last line is JSON, the exit code 0
only if every request got an answer, every malformed or foreign one a refusal with its reason, no node died, and the
repertoire is that of `core.search` for the same generations, bit for bit.

The memory of each node is measured after a fifth of the cases, when the replay buffer is full, and at the end.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

# The same fuzzer as in the tests, which run a few hundred of its cases.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test/graph"))

from domain_coordinator import domain_id
from fuzzer import Fuzzer
from graph import Graph, Probe, wait_until
from processes import children
from reference import run_digest, run_settings, search_digest
from std_srvs.srv import Trigger

from pga_me_ros.core.storage.repertoire import Repertoire

PARAMETERS = Path(__file__).resolve().parents[1] / "test/ros/parameter_fuzz.py"
RUN = {"evaluations": 10**7, "replay_size": 5000, "evaluators": 1}


def fuzz_a_run(folder: Path, cases: int, seed: int) -> dict[str, Any]:
    """Fuzz a running run, then stop it and compare its result.

    Returns:
        Figures; 'wrong' lists what went wrong.
    """
    values = {**RUN, "seed": seed}
    run_dir = folder / "run"
    with domain_id() as domain:
        graph, probe = Graph(domain, folder), Probe(domain)
        try:
            run = graph.run(run_dir, **values)
            fuzzer = Fuzzer(probe, run_settings(**values))
            before = children(run_dir)
            nodes = {**before, "orchestrator": run.process.pid}
            memory: list[dict[str, float]] = []
            began = (time.monotonic(), fuzzer.generation)

            def watch(done: int) -> None:
                if done % max(1, cases // 5) == 0:
                    memory.append({name: resident(pid) for name, pid in nodes.items()})
                    print(f"{done} cases, generation {fuzzer.generation}: {memory[-1]}", flush=True)

            fuzzer.fuzz(cases, watch)
            took = time.monotonic() - began[0]
            memory.append({name: resident(pid) for name, pid in nodes.items()})
            wrong = fuzzer.wrong + deaths(run_dir, before, run.process.poll())
            for words in wrong:
                print(f"WRONG: {words}", flush=True)
            seen = fuzzer.generation
            wait_until(lambda: fuzzer.generation > seen, "another generation")
            probe.call(Trigger, "orchestrator/stop")
            wrong += [] if run.wait() == 0 else [f"the run ended badly: {run.output[-500:]}"]
        finally:
            probe.close()
            graph.kill()
    with Repertoire.open(run_dir / "repertoire.db", read_only=True) as repertoire:
        generations = len(repertoire.metrics())
    same = run_digest(run_dir) == search_digest(**{**values, "evaluations": 10 * generations})
    return {
        "cases": sum(fuzzer.sent.values()),
        "targets": len(fuzzer.sent),
        "refusals": sum(fuzzer.refusals.values()),
        "topics_looked_at": len(fuzzer.heard),
        "messages_heard": sum(fuzzer.heard.values()),
        "seconds": round(took, 1),
        "generations_meanwhile": seen - began[1],
        "slowest_answers_s": {
            name: round(took, 2)
            for name, took in sorted(fuzzer.slowest.items(), key=lambda item: -item[1])[:3]
        },
        "memory_growth_MB": {
            name: round(memory[-1][name] - memory[0][name], 1) for name in memory[-1]
        },
        "same_repertoire": same,
        "wrong": wrong if same else [*wrong, "the repertoire differs"],
    }


def resident(pid: int) -> float:
    """Return the memory that a process uses, MB."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except OSError:
        return float("nan")
    return round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 1)


def deaths(run_dir: Path, before: dict[str, int], code: int | None) -> list[str]:
    """Return which processes died, as text."""
    out = [] if code is None else [f"the orchestrator ended with {code}"]
    now = children(run_dir)
    return out + [f"{name} died" for name, pid in before.items() if now.get(name) != pid]


def main() -> int:
    """Fuzz and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0, help="of the run; the cases are the same")
    arguments = parser.parse_args()
    parameters = subprocess.run([sys.executable, PARAMETERS], check=False)
    with tempfile.TemporaryDirectory() as folder:
        figures = fuzz_a_run(Path(folder), arguments.cases, arguments.seed)
    figures["wrong"] = len(figures["wrong"])
    figures["parameters_refused"] = parameters.returncode == 0
    print(json.dumps({"bench": "fuzz", "figures": figures}))
    return 1 if figures["wrong"] or parameters.returncode else 0


if __name__ == "__main__":
    sys.exit(main())
