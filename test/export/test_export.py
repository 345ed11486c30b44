"""Exports of a stored run, read back by the programs they are made for."""

from __future__ import annotations

import csv
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
import torch

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.reevaluations import Reevaluations
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.stored_run import REPERTOIRE, StoredRun
from pga_me_ros.export.__main__ import main
from pga_me_ros.export.arrays import write_pyribs
from pga_me_ros.export.source import Source
from pga_me_ros.library import StoredRun as OwnRun
from pga_me_ros.tasks.registry import task_spec

Actions = Float32Array
SPEC = task_spec("qd_hopper")
OBSERVATIONS = np.random.default_rng(1).normal(size=(1000, 15)).astype(np.float32)
EXTREME = (5.0 * np.sign(OBSERVATIONS)).astype(np.float32)
"""Observations with every entry at its limit of ±5, where sums and their rounding errors are largest."""


def archive_of(run: Path) -> Archive:
    with Repertoire.open(run / REPERTOIRE, read_only=True) as repertoire:
        return repertoire.load_archive()


def actions(run: Path, cell: int, observations: Actions = OBSERVATIONS) -> Actions:
    """Return the actions of our controller of a cell."""
    with Repertoire.open(run / REPERTOIRE, read_only=True) as repertoire:
        shape = MlpShape(repertoire.info.layer_sizes)
    controller = MlpController(shape, archive_of(run).parameters[cell])
    return np.stack([controller(observation) for observation in observations])


def exported(run: Path, out: Path, kind: str, *which: str) -> Path:
    assert main([str(run), "--to", kind, "--out", str(out), *which]) == 0
    return out


def onnx_actions(file: Path, observations: Actions = OBSERVATIONS) -> Actions:
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    return session.run(["action"], {"observation": observations})[0]


def torchscript_actions(file: Path, observations: Actions = OBSERVATIONS) -> Actions:
    return torch.jit.load(file)(torch.from_numpy(observations)).numpy()


MODELS = {"onnx": (".onnx", onnx_actions), "torchscript": (".pt", torchscript_actions)}


@pytest.mark.parametrize("kind", MODELS)
def test_an_exported_controller_gives_the_same_actions(
    hopper_run: Path, tmp_path: Path, kind: str
) -> None:
    ending, read = MODELS[kind]
    file = exported(hopper_run, tmp_path / f"best{ending}", kind, "--best")
    best = archive_of(hopper_run).best().cell
    np.testing.assert_allclose(read(file), actions(hopper_run, best), rtol=0, atol=1e-6)
    there = actions(hopper_run, best, EXTREME)
    np.testing.assert_allclose(read(file, EXTREME), there, rtol=0, atol=1e-5)


@pytest.mark.parametrize("kind", MODELS)
def test_all_controllers_go_into_a_folder(hopper_run: Path, tmp_path: Path, kind: str) -> None:
    ending, read = MODELS[kind]
    folder = exported(hopper_run, tmp_path / "all", kind)
    cells = archive_of(hopper_run).filled_cells().tolist()
    assert sorted(file.name for file in folder.iterdir()) == [
        f"cell-{c:02d}{ending}" for c in cells
    ]
    last = read(folder / f"cell-{cells[-1]:02d}{ending}")
    np.testing.assert_allclose(last, actions(hopper_run, cells[-1]), rtol=0, atol=1e-6)


def onnx_about(file: Path) -> dict[str, str]:
    return {prop.key: prop.value for prop in onnx.load(file).metadata_props}


def torchscript_about(file: Path) -> dict[str, str]:
    files = {"about.json": ""}
    torch.jit.load(file, _extra_files=files)
    return json.loads(files["about.json"])


@pytest.mark.parametrize(
    ("kind", "read"), [("onnx", onnx_about), ("torchscript", torchscript_about)]
)
def test_a_controller_describes_its_inputs_and_outputs(
    hopper_run: Path, tmp_path: Path, kind: str, read: Callable[[Path], dict[str, str]]
) -> None:
    about = read(exported(hopper_run, tmp_path / "best", kind, "--best"))
    best = archive_of(hopper_run).best()
    assert about["task"] == "qd_hopper"
    assert json.loads(about["fitness"]) == best.fitness
    assert json.loads(about["observation_names"]) == list(SPEC.observation_names)
    assert json.loads(about["control_period"]) == SPEC.control_period


def test_an_exported_actor_does_what_the_stored_one_does(dcrl_run: Path, tmp_path: Path) -> None:
    file = exported(dcrl_run, tmp_path / "actor.onnx", "onnx", "--actor")
    actor = OwnRun.load(dcrl_run).actor()
    wanted = np.random.default_rng(3).random((len(OBSERVATIONS), 1)).astype(np.float32)
    wanted[:2] = [[-0.5], [1.5]]  # beyond the bounds
    session = onnxruntime.InferenceSession(file, providers=["CPUExecutionProvider"])
    (given,) = session.run(["action"], {"observation": OBSERVATIONS, "descriptor": wanted})
    expected = [actor(o, d) for o, d in zip(OBSERVATIONS, wanted, strict=True)]
    np.testing.assert_allclose(given, expected, rtol=0, atol=2e-6)
    several = {
        "observation": np.tile(OBSERVATIONS[0], (9, 1)),
        "descriptor": np.linspace(0, 1, 9, dtype=np.float32)[:, None],
    }
    assert np.ptp(session.run(["action"], several)[0], axis=0).max() > 1e-3
    about = onnx_about(file)
    assert about["task"] == "qd_hopper"
    assert json.loads(about["descriptor_names"]) == list(SPEC.descriptor_names)
    assert json.loads(about["descriptor_high"]) == list(SPEC.descriptor_high)
    assert json.loads(about["layer_sizes"]) == [16, 16, 8, 3]


def test_a_controller_accepts_one_observation_at_a_time(hopper_run: Path, tmp_path: Path) -> None:
    file = exported(hopper_run, tmp_path / "best.pt", "torchscript", "--best")
    expected = actions(hopper_run, archive_of(hopper_run).best().cell)[0]
    action = torch.jit.load(file)(torch.from_numpy(OBSERVATIONS[0])).numpy()
    np.testing.assert_allclose(action, expected, rtol=0, atol=1e-6)


def test_npz_holds_every_elite_and_loads_without_pickle(hopper_run: Path, tmp_path: Path) -> None:
    file = exported(hopper_run, tmp_path / "all.npz", "npz")
    archive = archive_of(hopper_run)
    with np.load(file, allow_pickle=False) as arrays:
        assert arrays["cell"].tolist() == archive.filled_cells().tolist()
        for name, column in (
            ("fitness", archive.fitness),
            ("descriptor", archive.descriptors),
            ("parameters", archive.parameters),
            ("evaluation", archive.evaluations),
            ("steps", archive.steps),
        ):
            assert arrays[name].tobytes() == column[archive.filled].tobytes(), name
        assert tuple(arrays["observation_units"].tolist()) == SPEC.observation_units
        assert set(arrays["made_by"].tolist()) == {"random"}


def test_every_array_is_documented(hopper_run: Path, tmp_path: Path, again: Path) -> None:
    words = (Path(__file__).parents[2] / "docs/export.md").read_text()
    for kind in ("npz", "pyribs"):
        with np.load(exported(again, tmp_path / kind, kind)) as arrays:
            missing = [name for name in arrays.files if f"`{name}`" not in words]
        assert missing == [], kind


def test_the_same_run_gives_the_same_bytes(hopper_run: Path, tmp_path: Path) -> None:
    for kind in ("npz", "csv", "pyribs", "onnx"):
        which = ("--best",) if kind == "onnx" else ()
        first, second = (exported(hopper_run, tmp_path / n, kind, *which) for n in ("a", "b"))
        assert first.read_bytes() == second.read_bytes(), kind


def table(file: Path) -> list[dict[str, str]]:
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def test_csv_has_a_line_per_elite_with_all_digits(hopper_run: Path, tmp_path: Path) -> None:
    rows = table(exported(hopper_run, tmp_path / "all.csv", "csv"))
    archive = archive_of(hopper_run)
    assert [float(row["fitness"]) for row in rows] == archive.fitness[archive.filled].tolist()
    (name,) = SPEC.descriptor_names
    assert [float(row[name]) for row in rows] == archive.descriptors[archive.filled, 0].tolist()
    assert {row["parent1"] for row in rows} == {""}
    assert "mean_fitness" not in rows[0]


@pytest.fixture
def again(hopper_run: Path, tmp_path: Path) -> Path:
    """Return the run with two re-evaluations of its best elite."""
    run = Path(shutil.copytree(hopper_run, tmp_path / "again"))
    with Repertoire.open(run / REPERTOIRE, read_only=True) as repertoire:
        run_id, best = repertoire.info.run_id, repertoire.load_archive().best()
    Reevaluations(
        run_id,
        np.full(2, best.evaluation),
        np.arange(2),
        np.array([10.0, 20.0]),
        np.array([[0.2], [0.4]]),
        np.array([5, 6]),
        np.array([True, True]),
    ).save(run / REPERTOIRE)
    return run


def test_re_evaluations_are_exported(again: Path, tmp_path: Path) -> None:
    best = archive_of(again).best().cell
    rows = {int(row["cell"]): row for row in table(exported(again, tmp_path / "csv", "csv"))}
    (name,) = SPEC.descriptor_names
    assert (rows[best]["repeats"], rows[best]["mean_fitness"]) == ("2", "15.0")
    assert float(rows[best][f"mean:{name}"]) == pytest.approx(0.3)
    assert {row["mean_fitness"] for cell, row in rows.items() if cell != best} == {""}
    with np.load(exported(again, tmp_path / "npz", "npz")) as arrays:
        assert arrays["mean_fitness"][arrays["cell"] == best].tolist() == [15.0]


def test_the_best_is_the_best_on_average_unless_asked_otherwise(
    again: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lucky = archive_of(again).best()
    others = archive_of(again).fitness.copy()
    others[lucky.cell] = np.nan
    assert np.nanmax(others) > 15.0, "the test needs one that is better than the lucky one's mean"
    (row,) = table(exported(again, tmp_path / "mean.csv", "csv", "--best"))
    assert int(row["cell"]) == np.nanargmax(others)
    assert "in its single evaluation" in capsys.readouterr().err
    (row,) = table(exported(again, tmp_path / "single.csv", "csv", "--best", "--single"))
    assert (int(row["cell"]), row["fall_share"]) == (lucky.cell, "1.0")
    out = tmp_path / "none.csv"
    assert main([str(again), "--to", "csv", "--single", "--out", str(out)]) == 2
    assert "give it together with --best" in capsys.readouterr().err


def test_one_elite_is_chosen_by_cell_or_evaluation(hopper_run: Path, tmp_path: Path) -> None:
    archive = archive_of(hopper_run)
    cell = int(archive.filled_cells()[2])
    for which in (("--cell", cell), ("--evaluation", archive.evaluations[cell])):
        rows = table(exported(hopper_run, tmp_path / "one.csv", "csv", *map(str, which)))
        assert [row["cell"] for row in rows] == [str(cell)]


def ribs_archive(file: Path) -> Any:
    """Make an archive as described in docs/export.md."""
    import ribs.archives  # not at the top: seconds in each process that collects tests

    data = np.load(file)
    if "dims" in data:
        archive = ribs.archives.GridArchive(
            solution_dim=data["solution"].shape[1],
            dims=data["dims"],
            ranges=data["ranges"],
            epsilon=1e-6 * np.ptp(data["ranges"], axis=1),
        )
    else:
        archive = ribs.archives.CVTArchive(
            solution_dim=data["solution"].shape[1],
            centroids=data["centroids"],
            ranges=data["ranges"],
        )
    archive.add(data["solution"], data["objective"], data["measures"])
    return archive


@pytest.mark.parametrize("kind", ["cvt", "grid"])
def test_a_pyribs_archive_has_the_same_elites_in_the_same_cells(
    kind: str, hopper_run: Path, new_run: Callable[..., Path], tmp_path: Path
) -> None:
    grid = {"archive": "grid", "cells": None, "cvt_samples": None}
    run = hopper_run if kind == "cvt" else new_run(**grid)
    theirs = ribs_archive(exported(run, tmp_path / "ribs.npz", "pyribs")).data()
    ours = archive_of(run)
    order = np.argsort(theirs["index"])
    assert theirs["index"][order].tolist() == ours.filled_cells().tolist()
    assert theirs["objective"][order].tolist() == ours.fitness[ours.filled].tolist()
    assert theirs["measures"][order].tolist() == ours.descriptors[ours.filled].tolist()
    assert np.array_equal(theirs["solution"][order], ours.parameters[ours.filled])


def test_a_pyribs_archive_has_the_same_cells_for_a_descriptor_in_any_units(
    hopper_run: Path, tmp_path: Path
) -> None:
    low, high = np.array([0.0, -500.0]), np.array([1.0, 500.0])
    rng = np.random.default_rng(2)
    archive = CvtArchive(rng.uniform(low, high, (50, 2)), low, high, 3)
    solutions = Solutions.of(
        fitness=rng.random(200),
        descriptors=rng.uniform(low, high, (200, 2)),
        parameters=rng.random((200, 3)),
        evaluations=range(200),
    )
    archive.add(solutions)
    cells = tuple(archive.filled_cells().tolist())
    run = StoredRun.load(hopper_run)
    vars(run)["archive"] = archive  # in place of the archive that it would read
    source = Source(run, cells, one=False)
    write_pyribs(source, tmp_path / "ribs.npz")
    theirs = ribs_archive(tmp_path / "ribs.npz").data()
    order = np.argsort(theirs["index"])
    assert theirs["index"][order].tolist() == list(cells)
    assert theirs["objective"][order].tolist() == archive.fitness[archive.filled].tolist()


def run_program(*words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pga_me_ros.export", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd)


def test_the_file_is_named_after_the_run(hopper_run: Path, tmp_path: Path) -> None:
    result = run_program(str(hopper_run), "--to", "csv", cwd=tmp_path)
    assert (result.returncode, result.stdout, result.stderr) == (0, "run.csv\n", "")
    assert (tmp_path / "run.csv").is_file()


MISTAKES = {
    "no run": (["nowhere", "--to", "csv"], "There is no repertoire 'nowhere'"),
    "empty cell": (["RUN", "--to", "csv", "--cell", "EMPTY"], "is empty"),
    "no such cell": (["RUN", "--to", "csv", "--cell", "30"], "Cell 30 does not exist"),
    "no elite": (["RUN", "--to", "csv", "--evaluation", "99"], "of evaluation 99 is no elite"),
    "a folder": (["RUN", "--to", "csv", "--out", "."], "'.' is a folder"),
    "no actor": (
        ["RUN", "--to", "onnx", "--actor"],
        "of algorithm pga_map_elites, which learns no",
    ),
    "an actor as a table": (["RUN", "--to", "npz", "--actor"], "write --to onnx --actor"),
    "a file": (["RUN", "--to", "onnx", "--out", "taken/x"], "Cannot make the folder"),
}


@pytest.mark.parametrize("case", MISTAKES)
def test_a_mistake_is_reported_in_one_line(
    hopper_run: Path,
    tmp_path: Path,
    case: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").touch()
    archive = archive_of(hopper_run)
    empty = int(np.flatnonzero(~archive.filled)[0])
    words, said = MISTAKES[case]
    filled_in = {"RUN": str(hopper_run), "EMPTY": str(empty)}
    assert main([filled_in.get(word, word) for word in words]) == 2
    output, errors = capsys.readouterr()
    assert (output, errors.count("\n"), errors.startswith("error: ")) == ("", 1, True)
    assert said in errors


def test_the_error_for_a_missing_onnx_says_what_to_do(
    hopper_run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    assert main([str(hopper_run), "--to", "onnx"]) == 2
    assert "pip install onnx" in capsys.readouterr().err
