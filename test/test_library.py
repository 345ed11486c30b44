"""The package as a library: its public names, and stored runs in scripts and notebooks."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pga_me_ros
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.metrics_file import METRICS_FILE
from pga_me_ros.core.storage.reevaluations import Reevaluations
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.errors import PgaError, RequestError, StorageError
from pga_me_ros.library import StoredRun, save_run
from pga_me_ros.reevaluate.__main__ import reevaluate
from pga_me_ros.tasks.registry import make_task, task_spec

SETTINGS = Settings(
    task="qd_hopper",
    algorithm="map_elites",
    evaluations=20,
    random_init=10,
    batch_size=10,
    cells=30,
    cvt_samples=1000,
    controller_hidden=(8,),
)


@pytest.fixture(scope="module")
def search() -> Search:
    """Return a search after two generations."""
    task = make_task("qd_hopper")
    search = Search(task.spec, SETTINGS)
    for _ in range(2):
        search.run_generation(task)
    task.close()
    return search


@pytest.fixture(scope="module")
def saved(search: Search, tmp_path_factory: pytest.TempPathFactory) -> StoredRun:
    return save_run(tmp_path_factory.mktemp("saved") / "run", search)


def test_every_public_name_exists_and_is_listed() -> None:
    assert set(pga_me_ros.__all__) <= set(dir(pga_me_ros))
    for name in pga_me_ros.__all__:
        assert getattr(pga_me_ros, name).__doc__
    assert pga_me_ros.StoredRun is StoredRun
    with pytest.raises(AttributeError, match="has no attribute 'Serach'"):
        pga_me_ros.Serach  # noqa: B018


def test_importing_the_package_loads_nothing_else() -> None:
    code = (
        "import json, sys; before = set(sys.modules); import pga_me_ros; dir(pga_me_ros);"
        "print(json.dumps(sorted(set(sys.modules) - before)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    loaded = {name.partition(".")[0] for name in json.loads(result.stdout)}
    assert not loaded - {"pga_me_ros"} - set(sys.stdlib_module_names)


def test_a_saved_search_is_a_run_like_any_other(search: Search, saved: StoredRun) -> None:
    assert saved.archive.digest() == search.archive.digest()
    assert saved.settings == search.settings
    assert saved.spec == search.spec
    curves = ("qd_score", "coverage", "max_fitness", "evaluations", "offspring")
    for stored, own in zip(saved.metrics, search.metrics, strict=True):
        assert [getattr(stored, n) for n in curves] == [getattr(own, n) for n in curves]
    assert saved.metrics[-1] == search.metrics[-1]
    assert math.isnan(saved.metrics[0].min_fitness)
    rows = saved.file.with_name(METRICS_FILE).read_text().splitlines()
    assert len(rows) == 1 + len(search.metrics)


def test_a_saved_search_without_critics_can_resume(saved: StoredRun) -> None:
    directory = open_run(saved.file.parent, saved.spec, SETTINGS.replace(evaluations=30))
    directory.lock.release()
    assert (directory.run_id, directory.next_generation) == (saved.info.run_id, 2)


def test_a_saved_search_whose_solutions_are_evaluated_again_can_resume(tmp_path: Path) -> None:
    settings = SETTINGS.replace(extract_share=0.4, cell_depth=2)
    search, task = Search(task_spec("qd_hopper"), settings), make_task("qd_hopper")
    while search.generation < 3:
        search.run_generation(task)
    task.close()
    run = save_run(tmp_path / "run", search)
    with Repertoire.open(run.file) as file:
        stored = file.load_depth(file.load_archive(), settings.cell_depth)
    depth = search.depth
    assert depth is not None
    counts = {k: sample.count for k, sample in stored.samples.items()}
    assert max(counts.values()) > 1
    assert counts == {k: sample.count for k, sample in depth.samples.items()}
    drawn = [each.draw(settings.seed, 3, 3).tolist() for each in (stored, depth)]
    assert drawn[0] == drawn[1]


def test_what_cannot_be_saved_is_refused(search: Search, saved: StoredRun, tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="exists already"):
        save_run(saved.file.parent, search)
    with pytest.raises(RequestError, match="has no generation yet"):
        save_run(tmp_path / "run", Search(task_spec("qd_hopper"), SETTINGS))
    assert not (tmp_path / "run").exists()


def test_a_rollout_repeats_the_evaluation_or_starts_from_another_pose(saved: StoredRun) -> None:
    behavior = saved.choose()
    again = saved.rollout(behavior)
    assert (again.fitness, again.length) == (behavior.fitness, behavior.steps)
    assert np.array_equal(again.descriptor, behavior.descriptor)
    task = make_task("qd_hopper")
    one, two, three = (saved.rollout(behavior, seed, task) for seed in (1, 2, 1))
    task.close()
    assert np.array_equal(one.states, three.states)
    assert not np.array_equal(one.states[0], two.states[0])


def test_a_table_has_a_row_per_elite(saved: StoredRun) -> None:
    table = saved.to_dataframe()
    archive = saved.archive
    assert table["cell"].tolist() == archive.filled_cells().tolist()
    assert table["fitness"].tolist() == archive.fitness[archive.filled].tolist()
    assert table["foot/contact_share"].tolist() == archive.descriptors[archive.filled, 0].tolist()
    assert set(table["made_by"]) <= {"random", "ga"}
    assert "repeats" not in table


def test_a_table_has_the_means_of_re_evaluations(search: Search, tmp_path: Path) -> None:
    run = save_run(tmp_path / "run", search)
    reevaluate(run.file, repeats=2, best=1, processes=1)
    table = StoredRun.load(run.file).to_dataframe().set_index("cell")
    best = table.loc[search.archive.best().cell]
    known = Reevaluations.load(run.file, run.info.run_id, 1)
    assert best["repeats"] == 2
    assert best["mean_fitness"] == known.fitness.mean()
    assert best["mean:foot/contact_share"] == known.descriptor.mean()
    assert best["spread:foot/contact_share"] == known.descriptor.std(ddof=1)
    assert table["mean_fitness"].notna().sum() == 1


def test_without_pandas_the_table_says_what_to_install(
    saved: StoredRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(
        PgaError, match=r"pandas is not installed \(needed for to_dataframe\); install it with: "
    ):
        saved.to_dataframe()


def test_the_actor_of_a_run_is_asked_for_a_descriptor_and_needs_numpy_alone(dcrl_run: Path) -> None:
    run = StoredRun.load(dcrl_run)
    actor = run.actor()
    observation = np.linspace(-1, 1, run.spec.observation_dim, dtype=np.float32)
    one, other = actor(observation, [0.1]), actor(observation, [0.9])
    assert one.shape == (run.spec.action_dim,)
    assert np.abs(one - other).max() > 1e-3
    np.testing.assert_allclose(actor.at([0.9])(observation), other, rtol=0, atol=2e-6)
    assert actor.at([0.9]).shape == run.shape
    code = (
        "import sys; from pga_me_ros import StoredRun; StoredRun.load(sys.argv[1]).actor();"
        "print(sorted({'torch', 'pybullet', 'rclpy'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code, str(dcrl_run)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "[]\n"


def test_injected_elites_are_the_actor_of_their_generation(dcrl_run: Path) -> None:
    run = StoredRun.load(dcrl_run)
    made = {run.behavior(cell).made_by for cell in run.archive.filled_cells().tolist()}
    assert made <= {"random", "ga", "pg", "actor_injection"}
    assert sum(m.offspring[Operator.ACTOR_INJECTION] for m in run.metrics) == 2 * 2


def test_a_run_without_an_actor_says_so(saved: StoredRun, dcrl_run: Path, tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"map_elites, which learns no actor.*dcrl_map_elites"):
        saved.actor()
    copy = tmp_path / "repertoire.db"
    copy.write_bytes((dcrl_run / "repertoire.db").read_bytes())
    with pytest.raises(RequestError, match=r"there is no critic-\*\.ckpt and no actor\.npz"):
        StoredRun.load(copy).actor()
