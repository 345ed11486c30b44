"""Foreign subscribers that do not read, such as a suspended `ros2 topic echo` or a recorder that hangs."""

from __future__ import annotations

import re
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from graph import Graph, Probe, Started, wait_until
from pga_me_msgs.msg import Progress, Transitions
from pga_me_msgs.srv import Evaluate
from reference import run_digest, search_digest

from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import flat

OBSERVER = Path(__file__).with_name("observer.py")
TASK = "_talkative:TalkativeTask"
SHAPE = MlpShape((100, 4, 2))
EPISODE_BYTES = 4 * 200 * 100
"""Size of the observations in an episode of that task, in bytes."""

CHUNK = 50
HISTORY = qos.EXPERIENCE_WRITER.depth


@pytest.fixture
def hung(graph: Graph) -> Started:
    """Return a subscriber of experience and status, to be suspended when it has received something."""
    return graph.launch([sys.executable, str(OBSERVER)])


def hang(subscriber: Started) -> None:
    subscriber.wait_for_output("episode_of")
    subscriber.signal(signal.SIGSTOP)


def test_a_run_is_not_affected_by_a_subscriber_that_hangs(
    graph: Graph, probe: Probe, hung: Started, tmp_path: Path
) -> None:
    heard = probe.listen(Progress, names.PROGRESS, qos.LATCHED)
    run_dir, parameters = tmp_path / "run", {"evaluations": 60}
    run = graph.run(run_dir, **parameters)
    hang(hung)
    assert run.wait() == 0, run.output
    assert heard[-1].restarts == 0
    assert run_digest(run_dir) == search_digest(**parameters)


def memory(process: Started) -> int:
    """Return the memory of a process in bytes."""
    status = Path(f"/proc/{process.process.pid}/status").read_text()
    found = re.search(r"VmRSS:\s+(\d+) kB", status)
    assert found
    return 1024 * int(found[1])


class Driver:
    """Has an evaluator simulate one chunk after another."""

    def __init__(self, probe: Probe) -> None:
        self._probe = probe
        self.arrived: list[int] = []
        probe.node.create_subscription(
            Transitions,
            names.TRANSITIONS,
            lambda msg: self.arrived.append(msg.evaluation),
            qos.EXPERIENCE_READER,
        )
        self.asked = 0

    def evaluate(self, episodes: int) -> float:
        """Return the shortest time of a chunk in seconds, which excludes other processes' use of the cores."""
        return min(self._chunk() for _ in range(episodes // CHUNK))

    def _chunk(self) -> float:
        began = time.monotonic()
        response = self._probe.call(
            Evaluate,
            "mine/evaluate",
            run_id="a run",
            task=TASK,
            evaluations=range(self.asked, self.asked + CHUNK),
            layer_sizes=SHAPE.sizes,
            parameters=flat(np.zeros((CHUNK, SHAPE.parameter_count)), "f"),
        )
        assert response.accepted, response.message
        self.asked += CHUNK
        return time.monotonic() - began


def test_a_subscriber_that_hangs_neither_slows_an_evaluator_nor_makes_its_memory_grow(
    graph: Graph, probe: Probe, hung: Started, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Path(__file__).parents[2] / "bench"
    monkeypatch.setenv("PYTHONPATH", str(bench), prepend=":")
    evaluator = graph.start("evaluator", {"task": TASK}, "-r", "__node:=mine")
    driver = Driver(probe)
    before = driver.evaluate(4 * CHUNK)
    hang(hung)
    during = driver.evaluate(HISTORY + CHUNK)
    full = memory(evaluator)
    during = min(during, driver.evaluate(HISTORY + CHUNK))
    assert memory(evaluator) - full < 0.25 * HISTORY * EPISODE_BYTES
    assert (
        during < 2.0 * before
    )  # a publisher that waits for its reader would take a hundred times as long
    wait_until(lambda: len(driver.arrived) == driver.asked, "the others' experience, all of it")
