"""Reports on stored runs of tasks with one, two and four descriptors."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from pga_me_ros.core.archive.elites import Solutions
from pga_me_ros.core.archive.metrics import Metrics, generation_metrics
from pga_me_ros.core.operators import OPERATORS, Operator
from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.report.__main__ import draw, draw_comparison, main, table
from pga_me_ros.report.compared_run import ComparedRun
from pga_me_ros.report.comparison import compare
from pga_me_ros.report.lineage import COLORS, draw_lineage, look
from pga_me_ros.report.paper import published_beside, require_published
from pga_me_ros.report.pictures import LINE_STYLES, draw_archive, draw_color_scale, draw_curves
from pga_me_ros.tasks.registry import task_spec

TASKS = ["qd_hopper", "qd_walker", "qd_ant"]


def stored(
    folder: Path, task: str, seed: int, algorithm: str = "pga_map_elites", *, name: str = ""
) -> Path:
    """Store a run of three generations with made-up fitness and descriptors, perhaps of a task of another name."""
    spec = dataclasses.replace(task_spec(task), name=name or task)
    settings = Settings(
        task=task,
        algorithm=algorithm,
        seed=seed,
        cells=100,
        cvt_samples=1000,
        controller_hidden=(4,),
        batch_size=10,
        n_evo=10 if algorithm == "map_elites" else 5,
    )
    path = folder / f"{task}-{algorithm}-{seed}"
    directory = open_run(path, spec, settings)
    directory.lock.release()
    rng = np.random.default_rng(seed)
    before: Metrics | None = None
    with Repertoire.open(directory.repertoire) as repertoire:
        archive = repertoire.load_archive()
        for generation in range(3):
            batch = Solutions.of(
                fitness=rng.uniform(0, 100, 10),
                descriptors=rng.random((10, spec.descriptor_dim)),
                parameters=np.zeros((10, archive.parameter_count)),
                operators=[Operator(generation)] * 10,
                evaluations=range(10 * generation, 10 * generation + 10),
                generation=generation,
            )
            added = archive.add(batch)
            before = generation_metrics(archive, batch, added, generation, before)
            elites = [archive.elite(cell) for cell in added.changed_cells.tolist()]
            rates = {name: getattr(settings, name) for name in RATES}
            repertoire.commit(generation, elites, before, rates)
    return path


def test_the_lineage_has_the_color_of_every_operator_with_an_elite(tmp_path: Path) -> None:
    run = StoredRun.load(stored(tmp_path, "qd_walker", 1))
    (_, svg) = draw_lineage(run, tmp_path)
    made = {elite.operator for elite in run.archive.elites()}
    assert made == {Operator.RANDOM, Operator.GA, Operator.PG}
    drawing = svg.read_text()
    assert {operator for operator in Operator if look(operator)[0] in drawing} - {
        Operator.GREEDY
    } == made


def test_the_lineage_names_any_operator_with_an_elite(tmp_path: Path) -> None:
    run = StoredRun.load(stored(tmp_path, "qd_walker", 1))
    cells = run.archive.filled_cells()
    run.archive.operators[cells] = np.arange(len(cells)) % len(Operator)
    with mpl.rc_context({"svg.fonttype": "none"}):
        (_, svg) = draw_lineage(run, tmp_path)
    drawing = svg.read_text()
    for operator in Operator:
        assert f">{OPERATORS[operator].title}<" in drawing
        assert look(operator)[0] in drawing


def test_operators_differ_in_color_or_mark_even_if_there_are_more() -> None:
    assert len({look(operator) for operator in range(3 * len(COLORS))}) == 3 * len(COLORS)
    assert len({look(operator)[0] for operator in Operator}) == len(Operator)


@pytest.mark.parametrize("task", TASKS)
def test_pictures_of_one_run_are_not_empty(task: str, tmp_path: Path) -> None:
    files = draw([StoredRun.load(stored(tmp_path, task, 1))], tmp_path)
    assert [file.name for file in files] == [
        f"{task}-pga_map_elites-1-archive.png",
        f"{task}-pga_map_elites-1-archive.svg",
        f"{task}-pga_map_elites-1-lineage.png",
        f"{task}-pga_map_elites-1-lineage.svg",
        f"{task}-curves.png",
        f"{task}-curves.svg",
    ]
    for file in (files[0], files[2]):
        picture = imread(file)
        assert len(np.unique(picture.reshape(-1, picture.shape[-1]), axis=0)) > 20


def test_the_table_has_every_run_and_the_median(tmp_path: Path) -> None:
    runs = [StoredRun.load(stored(tmp_path, "qd_walker", seed)) for seed in (1, 2, 3)]
    lines = table(runs).splitlines()
    best = [run.metrics[-1].max_fitness for run in runs]
    assert [line.split(" | ")[-1] for line in lines[2:6]] == [
        f"{value:,.0f} |" for value in [*best, np.median(best)]
    ]


def test_algorithms_have_medians_and_curves_of_their_own(tmp_path: Path) -> None:
    of = {
        (algorithm, seed): StoredRun.load(stored(tmp_path, "qd_walker", seed, algorithm))
        for algorithm, seed in (("pga_map_elites", 1), ("pga_map_elites", 2), ("map_elites", 1))
    }
    lines = table(list(of.values())).splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]
    assert [row[1:3] for row in rows] == [
        ["pga_map_elites", "1"],
        ["pga_map_elites", "2"],
        ["pga_map_elites", "median"],
        ["map_elites", "1"],
    ]
    best = np.median([of["pga_map_elites", k].metrics[-1].max_fitness for k in (1, 2)])
    assert rows[2][-1] == f"{best:,.0f}"
    _, svg = draw_curves(list(of.values()), tmp_path)
    drawing = svg.read_text()
    assert all(color in drawing for color, _ in LINE_STYLES[:2])
    assert LINE_STYLES[2][0] not in drawing
    assert "<!-- map_elites -->" in drawing, "the legend names it"


def test_a_thinned_repertoire_has_no_part_in_medians_and_curves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for single in ("pictures.draw_archive", "lineage.draw_lineage"):  # not looked at here, and slow
        monkeypatch.setattr(f"pga_me_ros.report.{single}", lambda *_, **__: [])
    ready = StoredRun.load("zoo/qd_hopper")
    young = StoredRun.load(stored(tmp_path, "qd_hopper", 1))
    assert ready.is_thinned
    assert not young.is_thinned
    rows = [line.split(" | ") for line in table([ready, young]).splitlines()]
    assert [row[2] for row in rows if len(row) > 2] == ["seed", "1 (thinned)", "1"]
    alone, both = tmp_path / "alone", tmp_path / "both"
    for folder, runs in ((alone, [young]), (both, [young, ready])):
        folder.mkdir()
        draw(runs, folder)
    curves = "qd_hopper-curves.svg"
    assert (both / curves).read_bytes() == (alone / curves).read_bytes()


def test_the_same_run_gives_the_same_drawing(tmp_path: Path) -> None:
    run = StoredRun.load(stored(tmp_path, "qd_walker", 1))
    drawings = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (_, svg) = draw_archive(run, tmp_path / name)
        drawings.append(svg.read_bytes())
    assert drawings[0] == drawings[1]


def test_a_folder_without_a_run_is_reported_in_one_line(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pga_me_ros.report", str(tmp_path)]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr.startswith("error: ")
    assert result.stderr.count("\n") == 1
    assert str(tmp_path) in result.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["a/hop", "b/hop"], "in a folder named 'hop', so the pictures of one would replace"),
        (["a/hop", "copy"], "is the same run as 'a/hop/repertoire.db'"),
        (["a/hop", "--out", "file"], "Cannot make the folder 'file' (File exists)"),
        (["a/hop", "--out", "/proc/out"], "Cannot make the folder '/proc/out'"),
        (["a/hop", "--compare", "--out", "file"], "Cannot make the folder 'file'"),
        (["a/hop", "--paper"], "nothing on qd_hopper by pga_map_elites within 30 evaluations"),
        (["a/hop", "--paper", "--compare"], "nothing on qd_hopper by pga_map_elites within 30"),
        (["zoo/qd_hopper", "--paper"], "published nothing on qd_hopper by dcrl_map_elites within"),
    ],
)
def test_what_cannot_be_reported_is_told_before_anything_is_written(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, seed in (("a", 1), ("b", 2)):
        stored(tmp_path / name, "qd_hopper", seed).rename(f"{name}/hop")
    shutil.copytree("a/hop", "copy")
    Path("file").touch()
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "copy", "file"]


def test_published_curves_that_some_runs_can_have_are_drawn_and_the_others_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    long, short = (StoredRun.load(stored(tmp_path, task, 1)) for task in ("qd_walker", "qd_ant"))
    last = long.generations[-1]
    grown = dataclasses.replace(last.metrics, evaluations=1_000_000)
    longer = dataclasses.replace(long, generations=(dataclasses.replace(last, metrics=grown),))
    require_published(published_beside([longer, short]))
    assert capsys.readouterr().err == (
        "note: the authors published nothing on qd_ant by pga_map_elites within 30 evaluations\n"
    )


def test_a_grid_of_more_bins_than_pixels_is_drawn(
    new_run: Callable[..., Path], tmp_path: Path
) -> None:
    run = StoredRun.load(new_run(archive="grid"))
    assert run.archive.cells == 1000
    for file in draw_archive(run, tmp_path):
        assert file.stat().st_size > 0


@pytest.mark.parametrize("compare", [[], ["--compare"]], ids=["runs", "comparison"])
def test_a_task_may_have_any_name(tmp_path: Path, compare: list[str]) -> None:
    run = stored(tmp_path, "qd_hopper", 1, name="my/robot")
    command = [sys.executable, "-m", "pga_me_ros.report", run, "--out", tmp_path / "out", *compare]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "| my/robot |" in done.stdout
    made = [Path(line) for line in done.stdout.splitlines() if line.endswith((".png", ".svg"))]
    assert made
    assert all(path.parent == tmp_path / "out" and path.exists() for path in made)
    assert any("my_robot-" in path.name for path in made)


LONG_NAME = "a_robot_with_a_name_that_is_longer_than_its_picture_is_wide"


@pytest.mark.parametrize(("task", "name"), [("qd_hopper", LONG_NAME), ("qd_walker", "")])
def test_nothing_is_cut_off_at_the_edge_of_a_picture(tmp_path: Path, task: str, name: str) -> None:
    path = stored(tmp_path, task, 1, name=name)
    files = draw([StoredRun.load(path)], tmp_path)
    files += draw_comparison(compare([ComparedRun.load(path)]), tmp_path)
    pictures = [file for file in files if file.suffix == ".png"]
    assert len(pictures) == 5
    for file in pictures:
        picture = imread(file)[..., :3]
        edges = [picture[0], picture[-1], picture[:, 0], picture[:, -1]]
        assert all((edge == 1.0).all() for edge in edges), file.name


@pytest.mark.parametrize(
    ("outliers", "words"),
    [
        ([], "fitness"),
        ([5e3], "fitness; outliers: up to 5,000"),
        ([-7e3, 5e3], "fitness; outliers: down to -7,000, up to 5,000"),
    ],
)
def test_the_color_scale_tells_what_lies_beyond_it(outliers: list[float], words: str) -> None:
    figure = Figure()
    draw_color_scale(figure, figure.add_subplot(), "fitness", np.array([*range(100), *outliers]))
    assert figure.axes[1].get_ylabel() == words
