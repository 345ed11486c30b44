"""``query``: a served repertoire asked from a shell."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from stored import Served

from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.runs.start_from import read_controllers
from pga_me_ros.core.storage.reevaluations import FILE, Reevaluations, RepeatOutcome
from pga_me_ros.query.__main__ import main
from pga_me_ros.tasks.registry import task_spec

WANTED = ["0.6", "0.4"]


@pytest.fixture
def again(repertoire: Served) -> Reevaluations:
    """Two re-evaluations of the fittest elite, one of which ended in a fall."""
    best = repertoire.archive.best()
    rows = Reevaluations.none("run-of-the-tests", 2).with_more(
        [
            RepeatOutcome(best.evaluation, k, fitness, np.array([0.5, 0.5]), 9, bool(k))
            for k, fitness in enumerate((1000.0, 1010.0))
        ]
    )
    rows.save(repertoire.path)
    return rows


def run(repertoire: Served, *words: str) -> tuple[int, str]:
    """Run the program as a process; returns its exit status and what it printed."""
    started = repertoire.graph.launch([sys.executable, "-m", "pga_me_ros.query", *words])
    return started.wait(), started.output


def nearest(repertoire: Served, count: int) -> list[int]:
    cells, _ = repertoire.archive.nearest([0.6, 0.4], count)
    return cells.tolist()


def test_the_nearest_are_a_short_table(repertoire: Served) -> None:
    repertoire.path.with_name(FILE).unlink(missing_ok=True)
    code, output = run(repertoire, "--descriptor", *WANTED, "-k", "3")
    assert code == 0, output
    lines = output.splitlines()
    assert lines[0].startswith("qd_walker: 16 of 64 cells after 20 evaluations, finished")
    head = next(k for k, line in enumerate(lines) if line.split()[:1] == ["cell"])
    rows = [line.split() for line in lines[head + 1 :]]
    assert [int(row[0]) for row in rows] == nearest(repertoire, 3)
    fitness = repertoire.archive.fitness[nearest(repertoire, 1)[0]]
    assert rows[0][4:8] == [f"{fitness:.1f}", "-", "-", "-"]
    assert max(len(line) for line in lines) < 160


def test_means_are_shown_where_there_are_some(repertoire: Served, again: Reevaluations) -> None:
    code, output = run(repertoire, "--best")
    assert code == 0, output
    row = output.splitlines()[-1].split()
    assert row[4:9] == ["1005.0", "7.1", "2", "50", "%"]
    code, output = run(repertoire, "--single")
    assert output.splitlines()[-1].split()[5:8] == ["-", "-", "-"]


def test_json_has_all_that_is_known(repertoire: Served, again: Reevaluations) -> None:
    code, output = run(repertoire, "--descriptor", *WANTED, "-k", "16", "--json")
    assert code == 0, output
    content: dict[str, Any] = json.loads(output)
    assert (content["task"], content["run_id"]) == ("qd_walker", "run-of-the-tests")
    found = {b["cell"]: b for b in content["behaviors"]}
    assert set(found) == set(repertoire.archive.filled_cells().tolist())
    best = found[repertoire.archive.best().cell]
    assert (best["by_mean"], best["repeats"], best["fall_share"]) == (True, 2, 0.5)
    other = next(b for b in content["behaviors"] if not b["by_mean"])
    assert (other["repeats"], other["mean_fitness"], other["mean_descriptor"]) == (0, None, None)


@pytest.mark.parametrize("ending", ["npz", "onnx", "pt"])
def test_a_behavior_is_saved_as_export_saves_it(
    repertoire: Served, tmp_path: Path, ending: str
) -> None:
    cell = nearest(repertoire, 1)[0]
    path = tmp_path / f"gait.{ending}"
    code, output = run(repertoire, "--descriptor", *WANTED, "--save", str(path))
    assert code == 0, output
    assert output.splitlines()[-1] == f"saved: {path}"
    shape = MlpShape((22, 16, 16, 6))
    parameters = repertoire.archive.parameters[cell]
    if ending == "npz":
        controllers = read_controllers(path, task_spec("qd_walker"), shape)
        assert controllers.tobytes() == parameters.tobytes()
        return
    observation = np.linspace(-1, 1, 22, dtype=np.float32)
    if ending == "pt":
        torch = pytest.importorskip("torch")
        extra = {"about.json": ""}
        model = torch.jit.load(str(path), _extra_files=extra)
        action = model(torch.from_numpy(observation)[None]).numpy()
        about = json.loads(extra["about.json"])
    else:
        onnxruntime = pytest.importorskip("onnxruntime")
        session = onnxruntime.InferenceSession(str(path))
        (action,) = session.run(["action"], {"observation": observation[None]})
        about = session.get_modelmeta().custom_metadata_map
    expected = MlpController(shape, parameters)(observation)
    np.testing.assert_allclose(action[0], expected, atol=1e-6)
    assert json.loads(about["cell"]) == cell


def test_when_none_fits_the_nearest_is_named(repertoire: Served) -> None:
    code, output = run(repertoire, "--descriptor", "9", "9", "--max-distance", "0.1")
    assert code == 2
    assert output.startswith("error: No behavior lies within 0.1 of [9.0, 9.0]. The nearest is")
    assert output.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-k", "3"], "-k needs --descriptor"),
        (["--cell", "3", "--max-distance", "1"], "--max-distance needs --descriptor"),
        (["--descriptor", "1", "1", "-k", "0"], "-k is 0; give 1 or more"),
        (["--save", "gait.txt"], "give a name that ends in .onnx, .npz, .pt"),
        (["--descriptor", "1", "1", "-k", "2", "--save", "x.npz"], "--save writes one behavior"),
    ],
)
def test_options_that_would_be_ignored_are_refused(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
