"""What the page is given: descriptions of runs, packed motions, and one file without references to anywhere."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from browsing import ZOO
from pga_me_msgs.srv import GetInfo, ListGenerations

from pga_me_ros.client import ListedBehavior, ListedGeneration, RepertoireInfo
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.archive.grid import GridArchive
from pga_me_ros.core.archive.make_archive import cvt_archive
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError
from pga_me_ros.explorer import page
from pga_me_ros.explorer.__main__ import MOTIONS
from pga_me_ros.explorer.description import describe
from pga_me_ros.explorer.history import History
from pga_me_ros.explorer.motion import LEVELS, EpisodeStart, describe_motion, pack, recorded
from pga_me_ros.explorer.recorder import Recorder, chosen_cells
from pga_me_ros.explorer.served_archive import grid_bins, served_archive, spec_of
from pga_me_ros.player.watched_rollout import record
from pga_me_ros.ros.convert import behavior_to_msg
from pga_me_ros.serving.generations import list_generations
from pga_me_ros.tasks.registry import make_task, task_spec
from pga_me_ros.tasks.rollout import rollout


def unpacked(packed: dict) -> np.ndarray:
    """Return the table that `pack` packed, as the page reads it."""
    raw = np.frombuffer(base64.b64decode(packed["data"]), "<u2")
    return packed["low"] + np.array(packed["step"]) * raw.reshape(-1, packed["columns"])


def test_a_description_has_the_figures_of_every_elite(run: StoredRun) -> None:
    elites = json.loads(json.dumps(describe(run, "x"), allow_nan=False))["elites"]
    assert {len(column) for column in elites.values()} == {len(run.archive)}
    for row, cell in enumerate(elites["cell"]):
        behavior = run.behavior(cell)
        assert elites["fitness"][row] == behavior.fitness
        assert elites["mean_fitness"][row] == behavior.mean_fitness
        assert elites["fall_share"][row] == behavior.fall_share
        assert elites["parents"][row] == list(behavior.parents)
        assert elites["mean_cell"][row] == run.archive.cell_of(behavior.mean_descriptor[None])[0]


@pytest.mark.parametrize("shipped", [True, False], ids=["re-evaluated", "as it grew"])
def test_the_history_that_a_graph_tells_is_that_of_the_file(
    hopper_run: Path, shipped: bool
) -> None:
    run = StoredRun.load(ZOO if shipped else hopper_run)
    measured = {m.generation: m.corrected for m in run.reevaluations.measured}
    history = History()
    with Repertoire.open(run.file, read_only=True) as file:
        for first in range(len(run.generations)):
            response = ListGenerations.Response()
            request = ListGenerations.Request(first=first, limit=2)  # some come twice
            list_generations(file, run.archive.cells, measured, request, response)
            history.extend(ListedGeneration.from_response(response))
    stored, told = describe(run, "x"), history.described()
    assert told["curves"] == stored["curves"]
    assert told["contributions"] == stored["contributions"]
    for mine, theirs in zip(told["measured"], stored["measured"], strict=True):
        assert mine == {name: theirs[name] for name in mine}


def served(
    archive: Archive, task: str, names: Sequence[str], known: Statistics | None = None
) -> tuple[RepertoireInfo, list[ListedBehavior]]:
    """Return what the services tell of an archive."""
    known = known or Statistics.none(archive.cells, archive.dimensions)
    response = GetInfo.Response(task=task, archive=archive.kind, settings="{}", versions="{}")
    response.descriptor_names = list(names)
    response.descriptor_low = archive.low.tolist()
    response.descriptor_high = archive.high.tolist()
    response.metrics.cells = archive.cells
    behaviors = [
        ListedBehavior.from_msg(behavior_to_msg(elite, known, by_mean=False))
        for elite in archive.elites()
    ]
    return RepertoireInfo.from_response(response), behaviors


def filled(archive: Archive, count: int) -> Archive:
    """Put controllers without parameters to speak of into an archive, some of them on edges between cells."""
    rng = np.random.default_rng(0)
    shares = rng.random((count, archive.dimensions))
    shares[::3] = np.rint(12.0 * shares[::3]) / 12.0
    descriptors = archive.low + shares * (archive.high - archive.low)
    for cell, descriptor in zip(archive.cell_of(descriptors).tolist(), descriptors, strict=True):
        parameters = np.zeros(1, np.float32)
        archive.put(Elite(cell, 1.0, descriptor, parameters, 0, 0, Operator.GA, -1, -1, 5, False))
    return archive


@pytest.mark.parametrize(
    ("task", "served_as", "reason"),
    [
        ("nowhere:Lane", "lane", "task 'lane' is unknown on this machine"),
        ("qd_hopper", "qd_hopper", "task 'qd_hopper' has another descriptor on this machine"),
    ],
)
def test_a_served_task_that_is_unknown_or_another_one_here_has_its_cells(
    task: str, served_as: str, reason: str
) -> None:
    settings = Settings(task=task, cells=30, cvt_samples=1000)
    archive = filled(cvt_archive(30, [0.0, -1.0], [1.0, 2.0], 1000, 1), 50)
    info, behaviors = served(archive, served_as, ["x", "y"])
    spec, why = spec_of(info, settings)
    assert why == reason
    made, _, note = served_archive(info, spec, settings, behaviors)
    assert np.array_equal(made.centroids, archive.centroids)
    assert note == ""


def test_a_served_repertoire_that_was_thinned_has_its_own_cells(run: StoredRun) -> None:
    info, behaviors = served(run.archive, "qd_hopper", run.spec.descriptor_names, run.statistics)
    assert spec_of(info, run.settings) == (task_spec("qd_hopper"), "")
    made, known, note = served_archive(info, run.spec, run.settings, behaviors)
    assert np.array_equal(made.centroids, run.archive.centroids)
    assert np.array_equal(made.fitness[made.filled], run.archive.fitness[run.archive.filled])
    assert np.array_equal(known.mean_fitness, run.statistics.mean_fitness, equal_nan=True)
    assert note == ""


@pytest.mark.parametrize("bins", [(12,), (10, 8), (6, 6), (1, 36), (3, 4, 2), (4, 4, 4, 4)])
def test_the_bins_of_an_unknown_grid_follow_from_its_gaits(bins: tuple[int, ...]) -> None:
    d = len(bins)
    archive = filled(GridArchive(bins, [-1.0] * d, [2.0] * d, 1), 400)
    info, behaviors = served(archive, "far", [f"d{k}" for k in range(d)])
    settings = Settings(task="nowhere:Far", archive="grid")
    made, _, note = served_archive(info, spec_of(info, settings)[0], settings, behaviors)
    assert made.bins == bins
    assert note == (f"drawn as a grid of {' x '.join(map(str, bins))} bins, which its gaits fit")


def test_an_unknown_grid_of_few_gaits_is_one_that_has_them_in_their_cells() -> None:
    archive = filled(GridArchive((4, 9), [0.0, 0.0], [1.0, 1.0], 1), 2)
    info, behaviors = served(archive, "far", ["x", "y"])
    bins = grid_bins(info, behaviors)
    made = GridArchive(bins, [0.0, 0.0], [1.0, 1.0], 1)
    assert made.cells == 36
    assert made.cell_of([b.descriptor for b in behaviors]).tolist() == [b.cell for b in behaviors]


@pytest.mark.parametrize("kind", ["cvt", "grid"])
def test_cells_that_cannot_be_made_anew_are_told(kind: str) -> None:
    archive: Archive = GridArchive((6, 6), [0.0, 0.0], [1.0, 1.0], 1)
    if kind == "cvt":
        archive = cvt_archive(36, [0.0, 0.0], [1.0, 1.0], 500, 1)
    info, behaviors = served(filled(archive, 40), "far", ["x", "y"])
    cells = [b.cell for b in behaviors]
    moved = [
        dataclasses.replace(b, cell=cell)
        for b, cell in zip(behaviors, [*cells[3:], *cells[:3]], strict=True)
    ]
    samples = {"cvt_samples": 500} if kind == "cvt" else {}
    settings = Settings(task="nowhere:Far", archive=kind, **samples)
    spec, _ = spec_of(info, settings)
    made, _, note = served_archive(info, spec, settings, moved)
    assert made.cells == 36
    assert re.fullmatch(r"its cells are not known here, so \d+ of its gaits are drawn .*", note)


def test_what_was_not_reevaluated_is_null(hopper_run: Path) -> None:
    elites = describe(StoredRun.load(hopper_run), "x")["elites"]
    assert set(elites["mean_fitness"]) == set(elites["mean_cell"]) == {None}
    assert all(set(row) == {None} for row in elites["mean_descriptor"])


def test_packed_numbers_differ_by_half_a_step_at_most() -> None:
    table = np.random.default_rng(0).normal(size=(50, 4)) * [1.0, 100.0, 1e-3, 0.0] + 3.0
    packed = pack(table, LEVELS)
    assert np.all(np.abs(unpacked(packed) - table) <= 0.5001 * np.array(packed["step"]) + 1e-12)


@pytest.mark.parametrize(
    "start", [EpisodeStart(), EpisodeStart(seed=1)], ids=["evaluation", "unseen"]
)
def test_a_motion_is_that_of_the_rollout(run: StoredRun, start: EpisodeStart) -> None:
    task = make_task(run.settings.task)
    gait = run.choose(best=True)
    motion = describe_motion(recorded(task, run.settings, gait, start), run.spec, gait, start)
    rng = evaluation_rng(run.settings.seed, gait.evaluation)
    if start.seed is not None:
        rng = np.random.default_rng(start.seed)
    whole = record(task, gait.controller, rng)
    task.close()
    steps = np.rint(np.array(motion["seconds"]) / run.spec.control_period).astype(int)
    expected = np.array([[*s.base.position, *s.positions] for s in whole.states])[steps]
    frames = unpacked(motion["frames"])
    assert np.abs(np.delete(frames, range(3, 7), axis=1) - expected).max() < 1e-3
    assert (motion["fitness"], motion["fell"]) == (whole.episode.fitness, whole.episode.terminated)
    assert motion["kept"] is (True if start.seed is None else None)


@pytest.mark.parametrize(
    ("damage", "lost"),
    [("gone foot_joint", ["foot"]), ("gone leg_joint", ["foot", "leg"]), ("load 2", [])],
)
def test_a_damaged_robot_is_that_of_the_task_without_what_it_has_lost(
    run: StoredRun, damage: str, lost: list[str]
) -> None:
    recorder = Recorder(run.settings, run.behavior)
    gait = run.choose(best=True)
    motion = recorder.motion(gait.cell, EpisodeStart(4, damage=damage))
    sound = recorder.motion(gait.cell, EpisodeStart(4))
    recorder.close()
    assert (motion["lost"], sound["lost"]) == (lost, [])
    task = make_task(run.settings.task, damage=damage)
    episode = rollout(task, gait.controller, np.random.default_rng(4))
    task.close()
    assert motion["fitness"] == episode.fitness
    assert motion["fitness"] != sound["fitness"]


@pytest.mark.parametrize(
    "start",
    [
        EpisodeStart(),
        EpisodeStart(3),
        EpisodeStart(3, "mass 1 2, friction 0.5"),
        EpisodeStart(3, damage="jam foot_joint -0.1"),
        EpisodeStart(3, "mass 1 2", "load 2, ice"),
    ],
)
def test_the_key_of_a_start_names_it(start: EpisodeStart) -> None:
    assert EpisodeStart.of(start.key) == start


@pytest.mark.parametrize(
    "key", ["damaged:1:load 2", "damaged:x::load 2", "unseen:1:mass 2", "slow:1", "damaged:-1::ice"]
)
def test_a_key_that_names_no_start_is_refused(key: str) -> None:
    with pytest.raises(RequestError, match="give evaluation, unseen:SEED"):
        EpisodeStart.of(key)


@pytest.mark.parametrize("where", [{"randomization": "mass 2"}, {"damage": "ice"}])
def test_another_world_or_robot_needs_a_seed(where: dict[str, str]) -> None:
    with pytest.raises(RequestError, match="needs a seed"):
        EpisodeStart(**where)


def test_the_strip_averages_to_the_descriptor(run: StoredRun) -> None:
    recorder = Recorder(run.settings, run.behavior)
    behavior = run.choose(best=True)
    strip = recorder.motion(behavior.cell, EpisodeStart())["strip"]
    recorder.close()
    values = np.frombuffer(base64.b64decode(strip["data"]), "u1") * strip["step"][0]
    assert values.mean() == pytest.approx(behavior.descriptor[0], abs=0.01)  # every other step


def test_64_gaits_of_the_largest_robot_take_less_than_15_megabytes() -> None:
    steps, columns = 500, 7 + 8  # half of an ant's episode; its base, and eight joints
    frames = pack(np.random.default_rng(0).normal(size=(steps, columns)), LEVELS)
    strip = pack(np.random.default_rng(0).random((steps, 4)), 255)
    motion = {
        "frames": frames,
        "strip": strip,
        "seconds": [round(k * 0.033, 6) for k in range(steps)],
    }
    three = len(page.build_page({"title": "", "runs": []}))
    assert three + 2 * MOTIONS * len(json.dumps(motion)) < 15e6


def test_chosen_cells_have_the_best_gait(run: StoredRun) -> None:
    cells = chosen_cells(run, 5)
    assert len(cells) == 5
    assert run.choose(best=True).cell in cells
    assert chosen_cells(run, 0) == []


def test_the_page_refers_to_nothing_elsewhere() -> None:
    text = page.build_page({"title": "a </script><b>", "runs": [{"name": "</script><!--"}]})
    assert not re.search(r"""(?:src|href)\s*=\s*["']?(?:https?:)?//""", text)
    assert "@import" not in text
    assert text.count("<script") == text.count("</script>") == len(page.SCRIPTS) + 2
    assert "a &lt;/script&gt;&lt;b&gt;" in text
    own = sorted(path.name for path in Path(page.__file__).with_name("web").glob("*.js"))
    assert own == sorted(page.SCRIPTS)


def test_scripts_are_short_enough_to_read() -> None:
    files = Path(page.__file__).with_name("web").iterdir()
    assert {f.name: n for f in files if (n := len(f.read_text().splitlines())) > 330} == {}
