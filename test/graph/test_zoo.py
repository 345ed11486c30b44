"""A repertoire that comes with the package is served by its name, at once and by a light process."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from graph import Graph, Probe
from pga_me_msgs.srv import GetInfo
from stored import store

from pga_me_ros.client import RepertoireClient
from pga_me_ros.core.storage.reevaluations import Reevaluations, RepeatOutcome
from pga_me_ros.core.storage.shipped import VARIABLE
from pga_me_ros.errors import PgaError, RequestError, StorageError
from pga_me_ros.ros import names
from pga_me_ros.thin.__main__ import main as thin


@pytest.fixture(scope="module")
def zoo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one thinned repertoire."""
    folder = tmp_path_factory.mktemp("zoo")
    archive = store(folder / "run" / "repertoire.db")
    outcomes = [
        RepeatOutcome(elite.evaluation, k, elite.fitness + k, elite.descriptor, 9, k == 1)
        for elite in archive.elites()
        for k in range(4)
    ]
    rows = Reevaluations.none("run-of-the-tests", 2).with_more(outcomes)
    rows.save(folder / "run" / "repertoire.db")
    assert thin([str(folder / "run"), "--out", str(folder / "tiny_walker"), "--cells", "6"]) == 0
    shutil.rmtree(folder / "run")
    return folder


def libraries(pid: int) -> str:
    return Path(f"/proc/{pid}/maps").read_text()


def test_it_is_served_by_its_name_without_training_torch_or_simulator(
    zoo: Path, graph: Graph, probe: Probe, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(zoo))
    manager = graph.start("archive_manager", {"repertoire": "zoo/tiny_walker"})
    info = probe.call(GetInfo, names.GET_INFO)
    assert (info.task, info.growing) == ("qd_walker", False)
    assert 0 < info.metrics.coverage <= 6
    assert (info.metrics.corrected_repeats, info.metrics.corrected_fall_share) == (4, 0.25)
    assert info.metrics.corrected_coverage == info.metrics.coverage
    client = RepertoireClient(probe.node)
    *_, last = client.list_generations()
    assert last.corrected["qd_score"] == info.metrics.corrected_qd_score
    behavior = client.get_behavior(descriptor=[0.5, 0.5], max_fall_share=0.25)
    assert (behavior.repeats, behavior.by_mean, behavior.fall_share) == (4, True, 0.25)
    assert behavior.promised_fitness == pytest.approx(behavior.fitness + 1.5)
    assert behavior.controller(np.zeros(22)).shape == (6,)
    manager.wait_for_output(f"serves '{zoo}/tiny_walker/repertoire.db'")
    assert "re-evaluated 4 times or more, 25.0 % falls" in manager.output
    loaded = libraries(manager.process.pid)
    assert "numpy" in loaded
    assert "torch" not in loaded
    assert "pybullet" not in loaded


def test_a_client_serves_it_itself_and_leaves_nothing_behind(
    zoo: Path, probe: Probe, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(zoo))
    client = RepertoireClient(probe.node, timeout=60.0, repertoire="zoo/tiny_walker")
    assert client.get_behavior(best=True).repeats == 4
    assert client.get_info().task == "qd_walker"
    server = client._server
    assert server is not None
    pid = server._process.pid
    client.close()
    assert not Path(f"/proc/{pid}").exists()
    with pytest.raises(PgaError, match="own archive manager has ended"):
        client.get_info()
    with pytest.raises(StorageError, match=r"did you mean 'zoo/tiny_walker'"):
        RepertoireClient(probe.node, repertoire="zoo/tiny_waker")
    with pytest.raises(StorageError, match="There is no repertoire 'nowhere'"):
        RepertoireClient(probe.node, repertoire="nowhere")
    with pytest.raises(RequestError, match="give only one"):
        RepertoireClient(probe.node, "/left", repertoire="zoo/tiny_walker")


def test_a_client_serves_what_it_is_told_whatever_the_path_holds(
    zoo: Path, probe: Probe, tmp_path: Path
) -> None:
    for name in ("run #2", "gait: é"):  # YAML has other uses for these
        path = shutil.copytree(zoo / "tiny_walker", tmp_path / name)
        client = RepertoireClient(probe.node, timeout="60", repertoire=path)
        assert client.get_info().task == "qd_walker"
        client.close()


def test_a_client_whose_server_cannot_serve_says_why_at_once(probe: Probe, tmp_path: Path) -> None:
    file = tmp_path / "repertoire.db"
    file.write_bytes(b"no database")
    client = RepertoireClient(probe.node, timeout=600.0, repertoire=file)
    with pytest.raises(PgaError, match=r"own archive manager has ended: .*repertoire.db"):
        client.get_info()
    client.close()


def test_for_an_unknown_name_the_nearest_is_offered_in_one_line(
    zoo: Path, graph: Graph, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(zoo))
    manager = graph.start("archive_manager", {"repertoire": "zoo/tiny_waker"})
    assert manager.wait() == 2
    assert manager.output.startswith(
        "error: There is no repertoire 'zoo/tiny_waker' (did you mean 'zoo/tiny_walker'?)"
    )
    assert manager.output.count("\n") == 1
