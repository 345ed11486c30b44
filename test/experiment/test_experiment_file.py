"""Experiment files: the matrix they describe; every mistake is reported in one line before anything starts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from pga_me_ros.core.algorithms import ALGORITHMS
from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import RequestError, SettingsError, StorageError
from pga_me_ros.experiment.__main__ import main
from pga_me_ros.experiment.experiment_file import read_experiment
from pga_me_ros.experiment.plan import Cell
from pga_me_ros.experiment.stored_cell import require_own_run
from pga_me_ros.tasks.registry import BUILT_IN, task_spec

CONFIG = Path(__file__).parents[2] / "config" / "experiments"

GOOD = {
    "systems": "{pga_map_elites: , ga: {algorithm: map_elites}}",
    "tasks": "[qd_walker, qd_hopper]",
    "seeds": "[1, 2, 3]",
    "budget": "1000",
    "settings": "{batch_size: 60, controller_hidden: [16, 8]}",
}


def written(folder: Path, **changes: str | None) -> Path:
    """Write an experiment file; a change of None omits the key."""
    lines = [f"{key}: {value}" for key, value in {**GOOD, **changes}.items() if value is not None]
    path = folder / "file.yaml"
    path.write_text("\n".join(lines))
    return path


def test_the_matrix_has_every_system_task_and_seed_once(tmp_path: Path) -> None:
    cells = read_experiment(written(tmp_path)).cells
    assert [cell.index for cell in cells] == list(range(12))
    assert [cell.name for cell in cells[:5]] == [
        "pga_map_elites/qd_walker/1",
        "ga/qd_walker/1",
        "pga_map_elites/qd_hopper/1",
        "ga/qd_hopper/1",
        "pga_map_elites/qd_walker/2",
    ]
    assert len({cell.folder(tmp_path) for cell in cells}) == 12
    assert len({cell.namespace("paper-small") for cell in cells}) == 12


def test_more_seeds_do_not_move_other_cells(tmp_path: Path) -> None:
    few = read_experiment(written(tmp_path)).cells
    more = read_experiment(written(tmp_path, seeds="[1, 2, 3, 4]")).cells
    assert more[:12] == few


def test_a_cell_has_the_settings_of_experiment_and_system(tmp_path: Path) -> None:
    settings = read_experiment(written(tmp_path)).cells[3].settings
    assert (settings.task, settings.seed, settings.evaluations) == ("qd_hopper", 1, 1000)
    assert (settings.algorithm, settings.batch_size) == ("map_elites", 60)
    assert settings.controller_hidden == (16, 8)


def test_a_list_of_systems_names_algorithms(tmp_path: Path) -> None:
    experiment = read_experiment(written(tmp_path, systems="[map_elites, pga_map_elites]"))
    assert [cell.settings.algorithm for cell in experiment.cells[:2]] == [
        "map_elites",
        "pga_map_elites",
    ]
    assert experiment.reference == "pga_map_elites"


def test_a_million_may_be_written_as_1e6(tmp_path: Path) -> None:
    assert read_experiment(written(tmp_path, budget="1.0e+6")).budget == 1_000_000


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"systems": "[pga_map_elite]"}, "did you mean 'pga_map_elites'"),
        (
            {"systems": "{a: {n_evos: 5}}"},
            "system 'a': Unknown setting 'n_evos' (did you mean 'n_evo'",
        ),
        ({"systems": "{a: {n_evo: many}}"}, "system 'a': n_evo must be an integer"),
        ({"systems": "{a: {n_evo: 5}, b: {n_evo: 5}}"}, "'a' and 'b' have the same settings"),
        ({"systems": "{a b: {n_evo: 5}}"}, "'a b' has a name that is not valid in a ROS namespace"),
        ({"systems": "{a: 5}"}, "system 'a' is 5 (int)"),
        (
            {"systems": "{a: {seed: 5}}"},
            "gives 'seed', which comes from the key 'seeds' for all runs",
        ),
        ({"systems": "{a: {n_evo: 5}, a: {n_evo: 6}}"}, "column 26: 'a' is given twice"),
        ({"systems": "{}"}, "systems is empty"),
        ({"systems": "[map_elites, map_elites]"}, "systems has 'map_elites' twice"),
        ({"systems": None}, "systems is missing"),
        ({"tasks": "[qd_walker, qd_crawler]"}, "unknown task 'qd_crawler'"),
        ({"tasks": "[qd_walker, qd_walker]"}, "tasks has 'qd_walker' twice"),
        (
            {"tasks": "[qd_walker, 'pga_me_ros.tasks.bullet.locomotion:QDWalker']"},
            "are both called 'qd_walker'",
        ),
        ({"tasks": "qd_walker"}, "tasks is 'qd_walker' (str); give a list such as [qd_walker]"),
        ({"tasks": "[5]"}, "tasks has 5 in it"),
        ({"seeds": "[]"}, "seeds is empty"),
        ({"seeds": None}, "seeds is missing"),
        ({"seeds": "[1, 2, 1]"}, "seeds has 1 twice"),
        ({"seeds": "[-1]"}, "seed is -1"),
        ({"seeds": "[1.5]"}, "seeds has 1.5 in it"),
        ({"budget": "400"}, "budget of 400 evaluations is used up by the 500 random controllers"),
        ({"budget": None}, "budget is missing"),
        ({"budget": "much"}, "budget is 'much' (str)"),
        ({"settings": "{task: qd_walker}"}, "settings gives 'task'"),
        ({"settings": "{evaluations: 5}"}, "from the key 'budget'"),
        ({"settings": "{sigma: 5}"}, "Unknown setting 'sigma'"),
        ({"settings": "[5]"}, "settings is [5] (list)"),
        (
            {"systems": "[map_elites]", "settings": "{critic_hidden: [8]}"},
            "settings has critic_hidden, but none of the systems uses it; remove critic_hidden.",
        ),
        (
            {"systems": "{a: {algorithm: map_elites, critic_hidden: [8]}}"},
            "critic_hidden is (8,), but map_elites doesn't use it; remove critic_hidden.",
        ),
        ({"seed": "[1]"}, "unknown key 'seed' (did you mean 'seeds'?)"),
        ({"reference": "gaa"}, "reference is 'gaa' (did you mean 'ga'?)"),
        ({"budget": "["}, "is not valid YAML at line"),
    ],
)
def test_a_bad_file_is_reported_in_one_line_before_anything_starts(
    changes: dict[str, str | None],
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    file, folder = written(tmp_path, **changes), tmp_path / "runs"
    assert main([str(file), "--folder", str(folder)]) == 2
    said = capsys.readouterr()
    assert words in said.err
    assert str(file) in said.err
    assert (said.err.count("\n"), said.out) == (1, "")
    assert not folder.exists()


@pytest.mark.parametrize(("domain", "most"), [("abc", 232), ("233", 232), ("232", 231)])
def test_a_domain_that_it_cannot_use_is_reported_in_one_line(
    domain: str,
    most: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    file = written(tmp_path)
    assert main([str(file), "--folder", str(tmp_path / "runs"), "--jobs", "7"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(
        f"error: ROS_DOMAIN_ID is '{domain}'; expected a whole number from 0 to {most}"
    )
    assert said.count("\n") == 1


@pytest.mark.parametrize("content", ["", "5", "[1, 2]", "\xff\xfe"])
def test_a_file_with_other_content_is_reported(tmp_path: Path, content: str) -> None:
    path = tmp_path / "file.yaml"
    path.write_bytes(content.encode("latin-1"))
    with pytest.raises(SettingsError, match=r"expected the keys systems, tasks, seeds and budget"):
        read_experiment(path)


def test_a_missing_file_is_reported(tmp_path: Path) -> None:
    written(tmp_path)
    with pytest.raises(SettingsError, match=r"no experiment file .*did you mean 'file.yaml'"):
        read_experiment(tmp_path / "files.yaml")


def test_cells_are_chosen_by_index_name_and_pattern(tmp_path: Path) -> None:
    experiment = read_experiment(written(tmp_path))
    assert [c.index for c in experiment.chosen([])] == list(range(12))
    assert [c.index for c in experiment.chosen(["7", "ga/qd_walker/1"])] == [1, 7]
    assert [c.index for c in experiment.chosen(["ga/*/2", "5"])] == [5, 7]


@pytest.mark.parametrize("word", ["12", "-1", "ga/qd_walker/9", "*/ant/*"])
def test_an_unknown_cell_is_reported(tmp_path: Path, word: str) -> None:
    with pytest.raises(RequestError, match="There is no cell"):
        read_experiment(written(tmp_path)).chosen([word])


def test_shared_settings_go_to_the_systems_that_use_them(tmp_path: Path) -> None:
    systems = "{pg: {algorithm: pg_only}, ga: {algorithm: map_elites}, grid: {archive: grid}}"
    shared = "{critic_hidden: [8], cells: 40}"
    changes = {"systems": systems, "settings": shared, "reference": None}
    cells = read_experiment(written(tmp_path, **changes)).cells
    given = {
        cell.system: {name for name in ("critic_hidden", "cells") if name in cell.given}
        for cell in cells
    }
    assert given == {"pg": {"critic_hidden", "cells"}, "ga": {"cells"}, "grid": {"critic_hidden"}}
    assert all(cell.settings.critic_hidden == (8,) for cell in cells if cell.system != "ga")


SUCCESSOR = "dcrl_map_elites"


@pytest.mark.parametrize("name", ["paper_small", "paper"])
def test_the_experiments_of_the_paper_are_sound_and_have_all_systems_of_it(name: str) -> None:
    experiment = read_experiment(CONFIG / f"{name}.yaml")
    of_the_paper = [a for a in ALGORITHMS if a != SUCCESSOR]
    assert [system.name for system in experiment.systems] == of_the_paper
    assert experiment.reference == "pga_map_elites"
    if name == "paper":
        assert (len(experiment.seeds), experiment.budget) == (20, 1_000_000)
        assert experiment.tasks == tuple(BUILT_IN)


def test_the_experiment_with_the_successor_is_sound() -> None:
    experiment = read_experiment(CONFIG / "successor.yaml")
    assert SUCCESSOR in [system.name for system in experiment.systems]
    assert {cell.settings.algorithm for cell in experiment.cells} == {"pga_map_elites", SUCCESSOR}
    assert len(experiment.seeds) == 3


def test_a_system_that_is_called_like_an_algorithm_is_that_algorithm(tmp_path: Path) -> None:
    path = written(tmp_path, systems="{map_elites: {iso_sigma: 0.01}, mine: {n_evo: 30}}")
    cells = read_experiment(path).cells
    assert [(c.system, c.settings.algorithm) for c in cells[:2]] == [
        ("map_elites", "map_elites"),
        ("mine", "pga_map_elites"),
    ]


def test_a_system_cannot_have_the_name_of_another_algorithm(tmp_path: Path) -> None:
    path = written(tmp_path, systems="{map_elites: {algorithm: td3}}")
    with pytest.raises(SettingsError, match="system 'map_elites' has the algorithm 'td3'"):
        read_experiment(path)


def test_shared_settings_are_for_the_algorithms_that_use_them(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        systems="[pga_map_elites, map_elites]",
        settings="{n_crit: 7, controller_hidden: [16, 8]}",
    )
    first, second = (cell.settings for cell in read_experiment(path).cells[:2])
    assert (first.n_crit, first.controller_hidden) == (7, (16, 8))
    assert (second.n_crit, second.controller_hidden) == (Settings().n_crit, (16, 8))


def test_a_setting_of_one_system_that_it_does_not_use_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, systems="{map_elites: {n_crit: 7}}")
    with pytest.raises(SettingsError, match="n_crit is 7, but map_elites doesn't use it"):
        read_experiment(path)


def test_an_experiment_that_starts_from_a_run_knows_its_own_runs_again(
    tmp_path: Path, hopper_run: Path, new_run: Callable[..., Path]
) -> None:
    def cell_from(source: Path) -> Cell:
        systems = f"{{pga_map_elites: {{start_from: {source}}}, ga: {{algorithm: map_elites}}}}"
        cells = read_experiment(written(tmp_path, systems=systems, tasks="[qd_hopper]")).cells
        return cells[0]

    cell = cell_from(hopper_run)
    folder = cell.folder(tmp_path)
    folder.mkdir(parents=True)
    open_run(folder, task_spec("qd_hopper"), cell.settings).lock.release()
    require_own_run(cell, folder)
    other = cell_from(new_run(seed=6))
    with pytest.raises(StorageError, match=r"start_from: sha256:\w+ != sha256:"):
        require_own_run(other, folder)
