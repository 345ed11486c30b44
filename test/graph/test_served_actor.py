"""The actor of a repertoire, asked for by another node: before it is there, when it is, and when it changes."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from graph import Graph, Probe, wait_until
from stored import Served

from pga_me_ros import StoredRun
from pga_me_ros.client import ActorNotFoundError, RepertoireClient


def test_an_actor_is_served_as_soon_as_it_is_there_and_by_a_light_process(
    dcrl_run: Path, tmp_path: Path, graph: Graph, probe: Probe
) -> None:
    run = shutil.copytree(dcrl_run, tmp_path / "run")
    (trained,) = run.glob("critic-*.ckpt")
    later = trained.rename(tmp_path / "later")
    manager = graph.start("archive_manager", {"repertoire": run})
    client = RepertoireClient(probe.node, timeout=60.0)
    with pytest.raises(ActorNotFoundError, match="no training has ended yet"):
        client.get_actor()
    later.rename(trained)
    actor = client.get_actor()
    expected, seen = StoredRun.load(run).actor(), np.linspace(-1, 1, 15, dtype=np.float32)
    for wanted in ([0.0], [0.3], [1.0]):
        np.testing.assert_allclose(actor(seen, wanted), expected(seen, wanted), rtol=0, atol=5e-6)
    assert actor.generation == 3
    (run / "critic-00000009.ckpt").write_bytes(b"cut")
    answer = client.get_actor_async()
    wait_until(answer.done, "the actor")
    assert answer.result().generation == 3
    manager.wait_for_output("'critic-00000003.ckpt' is used instead")
    loaded = Path(f"/proc/{manager.process.pid}/maps").read_text()
    assert "numpy" in loaded
    assert "torch" not in loaded
    assert "pybullet" not in loaded


def test_an_algorithm_that_learns_none_says_so(repertoire: Served) -> None:
    client = RepertoireClient(repertoire.probe.node, timeout=60.0)
    with pytest.raises(
        ActorNotFoundError, match="of algorithm pga_map_elites, which learns no actor"
    ):
        client.get_actor()
    client.close()
