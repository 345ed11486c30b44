"""Everything is killed at random moments of one run, which ends with the repertoire of an undisturbed run.

`make chaos` does the same for minutes.
"""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph import DEADLINE, NOT_ALONE, TINY, Graph, Probe, Started, wait_until
from pga_me_msgs.msg import Transitions
from processes import children, kill_orchestrator, wait_for_no_children
from reference import run_digest, search_digest

from pga_me_ros.ros import names, qos

PARAMETERS: dict[str, Any] = {"evaluations": 120, "n_crit": 200}
B = int(TINY["batch_size"])

PAIRS = [
    ("critic_trainer", "evaluator_0"),
    ("archive_manager", "variation"),
    ("evaluator_0", "evaluator_1"),
]
"""Nodes that are killed together, so that one is missing while the other is being restarted."""

PATIENCE = 4 * DEADLINE
"""Seconds for a run that starts on a machine so busy that it takes minutes."""


class Moments:
    """Random moments of a run, defined by the number of episodes received of a generation."""

    def __init__(self, probe: Probe, seed: int) -> None:
        self._heard: list[Transitions] = probe.listen(
            Transitions, names.TRANSITIONS, qos.EXPERIENCE_READER
        )
        self._rng = np.random.default_rng(seed)
        self._generation = 1  # the next one is the first with gradients

    def wait_for_next(self, run: Started) -> None:
        """Wait for a random moment of the generation after the last one waited for, or of a later one."""
        self._generation += 1
        count = int(self._rng.integers(1, B, endpoint=True))
        self.wait_for(run, self._generation, count)

    def wait_for(self, run: Started, generation: int, count: int) -> None:
        """Wait until `count` episodes of a generation have been received, or one of a later generation."""

        def come() -> bool:
            assert run.process.poll() is None, run.output
            found = [m.generation for m in self._heard]
            return found.count(generation) >= count or max(found, default=-1) > generation

        wait_until(come, f"{count} episodes of generation {generation}")
        self._generation = max(m.generation for m in self._heard)

    @property
    def generation(self) -> int:
        """Newest generation of which an episode was received."""
        return self._generation


def kill(run_dir: Path, name: str) -> None:
    wait_until(lambda: name in children(run_dir), f"a living {name}")
    os.kill(children(run_dir)[name], signal.SIGKILL)


def kill_between_storing_and_adding(run: Started, run_dir: Path, moments: Moments) -> None:
    """Kill the whole run when the experience of a generation is stored but the generation is not yet in the archive."""
    generation = moments.generation + 1
    moments.wait_for(run, generation, B)
    generation = moments.generation
    # All its parents have been drawn: the archive is not needed again before the generation is added.
    os.kill(children(run_dir)["archive_manager"], signal.SIGSTOP)
    file = run_dir / "experience" / f"experience-{generation:08d}.ckpt"
    wait_until(file.exists, f"the stored experience of generation {generation}")
    left = children(run_dir)
    kill_orchestrator(run)
    for pid in left.values():
        os.kill(pid, signal.SIGKILL)
    wait_for_no_children(run_dir)
    assert run.output.count("QD-score") <= generation


def test_kills_of_everything_at_random_moments_change_nothing(
    graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    run_dir = tmp_path / "run"
    moments = Moments(probe, seed=0)
    run = graph.run(run_dir, **PARAMETERS, evaluators=2)
    for pair in PAIRS:
        moments.wait_for_next(run)
        for name in pair:
            kill(run_dir, name)
    moments.wait_for_next(run)
    kill_orchestrator(run)
    wait_for_no_children(run_dir)
    run = graph.run(run_dir, **PARAMETERS, evaluators=2)
    run.wait_for_output("generation")
    kill_between_storing_and_adding(run, run_dir, moments)
    run = graph.run(run_dir, **PARAMETERS, evaluators=2)
    assert run.wait() == 0, run.output
    assert run_digest(run_dir) == search_digest(**PARAMETERS)


@pytest.mark.parametrize(
    ("folders", "more"),
    [
        pytest.param(("run", "run"), {}, id="one-deaf"),
        pytest.param(("run", "other"), NOT_ALONE, id="two-listening"),
    ],
)
def test_if_two_runs_start_at_once_one_continues_and_the_other_is_refused(
    graph: Graph, tmp_path: Path, folders: tuple[str, str], more: dict[str, Any]
) -> None:
    """Even if they do not listen for each other: what they hear in time depends on how busy the machine is."""
    settings = {"evaluations": 10, "serve": True, **more}  # none ends before the other has begun
    runs = [graph.run(tmp_path / folder, **settings) for folder in folders]

    def one_has_ended() -> bool:
        return any(run.process.poll() is not None for run in runs)

    wait_until(one_has_ended, "one that is refused", PATIENCE)
    refused, continues = sorted(runs, key=lambda run: run.process.poll() is None)
    assert refused.wait() == 2, "".join(run.output for run in runs)
    holder = f"Another orchestrator runs as /orchestrator (process {continues.process.pid} on"
    assert refused.output.splitlines()[-1].startswith(f"error: {holder}")
    continues.wait_for_output("serving it", PATIENCE)
    continues.signal(signal.SIGTERM)
    assert continues.wait(PATIENCE) == 0, continues.output
    assert run_digest(tmp_path / folders[runs.index(continues)]) == search_digest(evaluations=10)
