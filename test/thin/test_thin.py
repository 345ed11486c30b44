"""A repertoire thinned to a few behaviors: which are kept, what goes with them, and that its name is enough."""

from __future__ import annotations

import dataclasses
import re
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.storage.reevaluations import file_name
from pga_me_ros.core.storage.shipped import VARIABLE
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.export.__main__ import main as export
from pga_me_ros.reevaluate.__main__ import reevaluate
from pga_me_ros.thin.__main__ import main
from pga_me_ros.thin.card import duration
from pga_me_ros.thin.choosing import Thinning, thinned

REPEATS = 3
KEPT = 5
ELSEWHERE = "mass 0.9 1.1"


@pytest.fixture(scope="module")
def run(new_run: Callable[..., Path]) -> StoredRun:
    """A run whose elites were re-evaluated."""
    folder = new_run(seed=11, evaluations=60, random_init=60)
    reevaluate(folder, REPEATS, processes=2)
    reevaluate(folder, 2, processes=2, randomization=ELSEWHERE)
    return StoredRun.load(folder)


@pytest.fixture(scope="module")
def zoo(run: StoredRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one thinned repertoire in it."""
    zoo = tmp_path_factory.mktemp("zoo")
    words = [str(run.file.parent), "--out", str(zoo / "tiny_hopper"), "--cells", str(KEPT)]
    assert main([*words, "--remark", "On a machine of the tests."]) == 0
    return zoo


@pytest.fixture
def named(zoo: Path, monkeypatch: pytest.MonkeyPatch) -> StoredRun:
    """The thinned repertoire, read by its name."""
    monkeypatch.setenv(VARIABLE, str(zoo))
    return StoredRun.load("zoo/tiny_hopper")


def test_what_is_kept_are_elites_of_the_run_with_their_re_evaluations(
    run: StoredRun, named: StoredRun
) -> None:
    archive = named.archive
    assert 2 <= archive.coverage <= KEPT
    known = named.statistics
    for cell in archive.filled_cells().tolist():
        elite = archive.elite(cell)
        (own,) = np.flatnonzero(run.archive.evaluations == elite.evaluation)
        theirs = run.archive.elite(int(own))
        assert dataclasses.replace(theirs, cell=cell).to_bytes() == elite.to_bytes()
        for name, values in vars(known).items():
            expected = getattr(run.statistics, name)[own]
            np.testing.assert_array_equal(values[cell], expected, err_msg=name)
        assert archive.cell_of(known.mean_descriptor[cell][None]).tolist() == [cell]
    assert named.corrected is not None
    assert named.corrected.coverage == archive.coverage, "none is hidden by another one"
    assert set(named.reevaluations.evaluation.tolist()) == set(
        archive.evaluations[archive.filled].tolist()
    )


def test_what_is_kept_takes_along_what_it_does_in_other_worlds(
    run: StoredRun, named: StoredRun, zoo: Path
) -> None:
    assert named.worlds is not None
    assert run.worlds is not None
    kept = np.sort(named.archive.evaluations[named.archive.filled_cells()])
    assert named.worlds.evaluations.tolist() == kept.tolist()
    np.testing.assert_array_equal(named.worlds.fitness, run.worlds.promises(kept))
    assert [rows.elsewhere for rows in named.elsewhere] == [ELSEWHERE]
    text = (zoo / "tiny_hopper/card.md").read_text()
    assert f"Where {ELSEWHERE} is randomized (at least 2 re-evaluations each): mean" in text
    assert "unlike those named above" in text
    assert "and nowhere else" not in text


def test_the_best_of_each_part_is_kept(run: StoredRun, named: StoredRun) -> None:
    cells = run.archive.filled_cells()
    means, places = run.statistics.mean_fitness[cells], run.statistics.mean_descriptor[cells]
    parts = named.archive.cell_of(places)
    assert set(parts.tolist()) == set(named.archive.filled_cells().tolist())
    for part in set(parts.tolist()):
        inside = parts == part
        assert named.statistics.mean_fitness[part] == means[inside].max()


def test_more_cells_than_elites_are_no_more_work(run: StoredRun) -> None:
    kept = thinned(run.archive, run.statistics, Thinning(10**11))
    assert 0 < len(kept) <= len(run.archive)
    assert kept.digest() == thinned(run.archive, run.statistics, Thinning(10**12)).digest()


def test_the_card_tells_where_it_comes_from(run: StoredRun, zoo: Path) -> None:
    card = (zoo / "tiny_hopper" / "card.md").read_text()
    assert card.startswith("# tiny_hopper: ")
    assert f"Run {run.info.run_id}." in card
    assert "60 evaluations in 6 generations" in card
    assert "On a machine of the tests." in card
    assert run.corrected is not None
    assert f"| {100 * run.corrected.fall_share:.1f}% |" in card
    assert "-p task:=qd_hopper -p seed:=11" in card
    assert "-p 'controller_hidden:=[16, 8]'" in card
    assert "reevaluate RUN --repeats 3" in card
    assert f"thin RUN --out tiny_hopper --cells {KEPT}" in card
    assert str(zoo) not in card, "it has a path of this machine"
    assert re.search(r"foot/contact_share \d\.\d\d to \d\.\d\d", card)


def test_what_is_thinned_again_does_not_pass_for_a_run(named: StoredRun, tmp_path: Path) -> None:
    assert named.is_thinned
    assert main([str(named.file), "--out", str(tmp_path / "less"), "--cells", "2"]) == 0
    card = (tmp_path / "less" / "card.md").read_text()
    assert "60 evaluations, begun" in card
    assert f"Of its {KEPT} behaviors that were kept of it before, these 2 have" in card
    assert "| | kept before | these |" in card
    assert "as the card of what was kept before says" in card
    assert StoredRun.load(tmp_path / "less").is_thinned


def test_the_file_can_be_read_where_nothing_can_be_written(
    zoo: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path(shutil.copytree(zoo / "tiny_hopper", tmp_path / "tiny_hopper"))
    with sqlite3.connect(folder / "repertoire.db") as connection:
        (mode,) = connection.execute("PRAGMA journal_mode").fetchone()
    connection.close()
    assert mode == "delete"
    before = sorted(path.name for path in folder.iterdir())
    StoredRun.load(folder)
    assert (
        sorted(path.name for path in folder.iterdir())
        == before
        == [
            "card.md",
            file_name(ELSEWHERE),
            "reevaluations.npz",
            "repertoire.db",
        ]
    )


def test_export_takes_the_name(
    named: StoredRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "all.csv"
    assert export(["zoo/tiny_hopper", "--to", "csv", "--out", str(out)]) == 0
    assert len(out.read_text().splitlines()) == 1 + named.archive.coverage


def test_for_an_unknown_name_the_nearest_is_offered(
    named: StoredRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert export(["zoo/tiny_hoper", "--to", "csv", "--out", str(tmp_path / "x.csv")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(
        "error: There is no repertoire 'zoo/tiny_hoper' (did you mean 'zoo/tiny_hopper'?); those that come with"
    )
    assert error.count("\n") == 1


def test_a_folder_of_ones_own_by_that_name_comes_first(
    run: StoredRun, named: StoredRun, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(run.file.parent, tmp_path / "zoo" / "tiny_hopper")
    assert StoredRun.load("zoo/tiny_hopper").archive.coverage == run.archive.coverage


def test_a_repertoire_is_not_overwritten(
    run: StoredRun, zoo: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (zoo / "tiny_hopper" / "repertoire.db").read_bytes()
    assert main([str(run.file.parent), "--out", str(zoo / "tiny_hopper")]) == 2
    assert "holds a repertoire; give --out another folder" in capsys.readouterr().err
    assert (zoo / "tiny_hopper" / "repertoire.db").read_bytes() == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--cells", "0"], "--cells is 0; give 1 or more"),
        (["--max-fall-share", "5"], "--max-fall-share is 5.0; give a share from 0 to 1"),
        (["--max-spread", "-1"], "--max-spread is -1.0; give a share from 0 to 1"),
        (["--min-fitness", "nan"], "--min-fitness is or holds nan; give a number"),
        (["--min-fitness", "1e9"], "No behavior is as steady and as fit as wanted"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(
    run: StoredRun,
    tmp_path: Path,
    words: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "out"
    assert main([str(run.file.parent), "--out", str(out), *words]) == 2
    assert message in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize("step", ["Reevaluations.save", "save_bytes", "rename_file"])
def test_a_repertoire_is_whole_or_not_there(
    run: StoredRun,
    tmp_path: Path,
    step: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    full = Mock(side_effect=StorageError("The disk is full."))
    monkeypatch.setattr(f"pga_me_ros.thin.__main__.{step}", full)
    assert main([str(run.file.parent), "--out", str(tmp_path / "out")]) == 2
    assert "error: The disk is full." in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_damaged_re_evaluations_in_another_world_are_found_first(
    run: StoredRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged = Path(shutil.copytree(run.file.parent, tmp_path / "run"))
    (damaged / file_name(ELSEWHERE)).write_text("damaged")
    assert main([str(damaged), "--out", str(tmp_path / "out")]) == 2
    assert "is damaged or no file of re-evaluations" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_nothing_is_mixed_with_what_a_folder_holds(
    run: StoredRun, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "card.md").write_text("of another one")
    assert main([str(run.file.parent), "--out", str(tmp_path)]) == 2
    assert "is not empty; give --out a new one" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["card.md"]


def test_without_re_evaluations_nothing_is_thinned(
    hopper_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(hopper_run), "--out", str(tmp_path / "out")]) == 2
    assert "were re-evaluated twice or more" in capsys.readouterr().err


def archive_of(places: np.ndarray) -> Archive:
    """Return an archive of the unit box with an elite at each of (n, d) places, in cells of their own."""
    n, d = places.shape
    archive = CvtArchive(places, (0.0,) * d, (1.0,) * d, 1)
    archive.add(
        Solutions.of(
            fitness=np.zeros(n),
            descriptors=places,
            parameters=np.zeros((n, 1)),
            evaluations=range(n),
        )
    )
    return archive


@pytest.fixture
def archive() -> Archive:
    """Forty elites along a line."""
    return archive_of((np.arange(40)[:, None] + 0.5) / 40)


def known(archive: Archive, fitness: np.ndarray, falls: np.ndarray, spread: float) -> Statistics:
    return Statistics(
        np.full(archive.cells, 10),
        fitness,
        np.ones(archive.cells),
        archive.descriptors.copy(),
        np.full(archive.descriptors.shape, spread),
        falls,
    )


def test_as_many_as_wanted_are_kept_though_only_a_part_of_the_space_is_covered(
    archive: Archive,
) -> None:
    archive.filled[:30] = False
    kept = thinned(archive, known(archive, np.arange(40.0), np.zeros(40), 0.0), Thinning(8))
    assert 7 <= kept.coverage <= 8
    assert 39 in kept.evaluations[kept.filled]


def test_few_elites_in_a_space_of_many_dimensions_are_thinned_to_as_many_as_wanted() -> None:
    rng = np.random.default_rng(0)
    places = 0.5 + 0.1 * rng.random((200, 4))  # a ten-thousandth of the box
    archive, fitness = archive_of(places), rng.random(200)
    steady = known(archive, fitness, np.zeros(200), 0.0)
    kept = thinned(archive, steady, Thinning(50))
    assert kept.coverage == 50
    owners = kept.cell_of(places)
    for cell, evaluation in zip(kept.filled_cells(), kept.evaluations[kept.filled], strict=True):
        assert fitness[evaluation] == fitness[owners == cell].max()
    assert kept.digest() == thinned(archive, steady, Thinning(50)).digest()


def test_what_falls_or_varies_too_much_is_left_out(archive: Archive) -> None:
    falls = np.where(np.arange(40) % 2, 0.5, 0.0)
    statistics = known(archive, np.arange(40.0), falls, 0.1)
    kept = thinned(archive, statistics, Thinning(10, max_fall_share=0.2))
    assert len(kept)
    assert not (kept.evaluations[kept.filled] % 2).any()
    with pytest.raises(RequestError, match=r"least spread of a descriptor is 0\.100, and the"):
        thinned(archive, statistics, Thinning(10, max_spread=0.05))


def test_what_is_not_fit_enough_is_left_out(archive: Archive) -> None:
    statistics = known(archive, np.arange(40.0), np.zeros(40), 0.1)
    kept = thinned(archive, statistics, Thinning(40, min_fitness=30.0))
    assert len(kept)
    assert kept.evaluations[kept.filled].min() >= 30
    with pytest.raises(RequestError, match=r"the greatest mean fitness 39\.0; allow more"):
        thinned(archive, statistics, Thinning(40, min_fitness=39.5))


def test_pauses_do_not_count_as_time(run: StoredRun) -> None:
    first = run.generations[0]
    times = [f"2026-01-01T00:{minute:02d}:00.000+00:00" for minute in range(0, 20, 2)]
    times += [f"2026-01-03T07:{minute:02d}:00.000+00:00" for minute in range(0, 20, 2)]
    generations = [dataclasses.replace(first, committed=time) for time in times]
    # Nine steps of two minutes, the pause counted as one, nine more.
    assert duration(generations) == "38 min"
    assert duration(generations[:1]) == "an unknown time"


def test_the_actor_goes_along_and_is_exported_as_from_the_run(
    dcrl_run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = shutil.copytree(dcrl_run, tmp_path / "run")
    reevaluate(whole, REPEATS, processes=2)
    few, again = tmp_path / "few", tmp_path / "again"
    assert main([str(whole), "--out", str(few), "--cells", "4"]) == 0
    assert main([str(few), "--out", str(again), "--cells", "2"]) == 0
    assert "holds the actor as trained for generation 3" in (again / "card.md").read_text()
    models = []
    for folder in (whole, few, again):
        out = tmp_path / f"{folder.name}.onnx"
        assert export([str(folder), "--to", "onnx", "--actor", "--out", str(out)]) == 0
        models.append(out.read_bytes())
    assert models[0] == models[1] == models[2]
    for file in whole.glob("critic-*.ckpt"):
        file.unlink()
    capsys.readouterr()
    assert main([str(whole), "--out", str(tmp_path / "bare")]) == 0
    assert "note: without an actor: Next to" in capsys.readouterr().err
    assert "actor" not in (tmp_path / "bare" / "card.md").read_text().partition("Made by")[0]
    assert not (tmp_path / "bare" / "actor.npz").exists()
