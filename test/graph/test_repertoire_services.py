"""Requests of other robot nodes, answered by an archive manager from a finished file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph import Graph, Probe, wait_until
from nav_msgs.msg import OccupancyGrid
from pga_me_msgs.msg import Metrics
from pga_me_msgs.srv import GetBehavior, GetInfo, ListBehaviors
from sensor_msgs.msg import Image
from stored import SETTINGS, SPEC, Served, served

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.ros import qos

ASK = GetBehavior.Request
BEYOND = 1e6
"""A fitness that no elite has."""


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("empty"), generations=0) as repertoire:
        yield repertoire


def ask(repertoire: Served, **fields: Any) -> GetBehavior.Response:
    return repertoire.probe.call(GetBehavior, "repertoire/get_behavior", **fields)


def ask_list(repertoire: Served, **fields: Any) -> ListBehaviors.Response:
    return repertoire.probe.call(ListBehaviors, "repertoire/list_behaviors", **fields)


def distances(archive: Archive, wanted: list[float]) -> np.ndarray:
    """Return the distance of every cell's elite, infinity for empty cells."""
    return np.nan_to_num(np.linalg.norm(archive.descriptors - wanted, axis=1), nan=math.inf)


@pytest.mark.parametrize("wanted", [[0.9, 0.1], [0.0, 0.0], [-3.0, 7.5]])
def test_a_descriptor_gives_the_nearest_elite(repertoire: Served, wanted: list[float]) -> None:
    response = ask(repertoire, descriptor=wanted)
    everyone = distances(repertoire.archive, wanted)
    assert response.found, response.message
    assert response.behavior.cell == everyone.argmin()
    assert response.distance == pytest.approx(everyone.min(), abs=1e-12)


def test_a_cell_gives_its_elite(repertoire: Served) -> None:
    cell = int(repertoire.archive.filled_cells()[3])
    elite = repertoire.archive.elite(cell)
    behavior = ask(repertoire, select=ASK.CELL, cell=cell).behavior
    got = (behavior.fitness, list(behavior.descriptor), behavior.evaluation, behavior.steps)
    assert got == (elite.fitness, elite.descriptor.tolist(), elite.evaluation, elite.steps)


def test_the_best_is_the_fittest(repertoire: Served) -> None:
    assert ask(repertoire, select=ASK.BEST).behavior.fitness == repertoire.archive.max_fitness


def test_random_choices_give_different_elites_that_are_fit_enough(repertoire: Served) -> None:
    least = float(np.nanmedian(repertoire.archive.fitness))
    drawn = [
        ask(repertoire, select=ASK.RANDOM, require_fitness=True, min_fitness=least).behavior
        for _ in range(40)
    ]
    assert min(b.fitness for b in drawn) >= least
    assert len({b.cell for b in drawn}) > 3


def test_the_controller_has_everything_needed_to_run_it(repertoire: Served) -> None:
    response = ask(repertoire, select=ASK.BEST)
    controller = response.controller
    elite = repertoire.archive.best()
    assert np.array_equal(np.array(controller.parameters, np.float32), elite.parameters)
    assert list(controller.layer_sizes) == [22, 16, 16, 6]
    assert controller.activations == ["relu", "relu", "tanh"]
    assert tuple(controller.observation_names) == SPEC.observation_names
    assert tuple(controller.action_units) == SPEC.action_units
    assert controller.control_period == SPEC.control_period


def test_with_a_minimum_fitness_a_farther_elite_is_the_nearest(repertoire: Served) -> None:
    archive = repertoire.archive
    wanted = archive.descriptors[int(np.nanargmin(archive.fitness))].tolist()
    least = float(np.nanmedian(archive.fitness))
    behavior = ask(repertoire, descriptor=wanted, require_fitness=True, min_fitness=least).behavior
    everyone = np.where(archive.fitness >= least, distances(archive, wanted), math.inf)
    assert behavior.cell == everyone.argmin()


NOT_FOUND = {
    "too far": ({"descriptor": [5.0, 5.0], "max_distance": 0.5}, "No behavior lies within 0.5 of"),
    "none so fit": (
        {"descriptor": [0.5, 0.5], "require_fitness": True, "min_fitness": BEYOND},
        "No behavior has a fitness of 1000000.0 or more; the best has",
    ),
    "best not so fit": (
        {"select": ASK.BEST, "require_fitness": True, "min_fitness": BEYOND},
        "No behavior has a fitness of 1000000.0 or more",
    ),
    "random not so fit": (
        {"select": ASK.RANDOM, "require_fitness": True, "min_fitness": BEYOND},
        "No behavior has a fitness of 1000000.0 or more",
    ),
    "no such cell": (
        {"select": ASK.CELL, "cell": 64},
        "Cell 64 does not exist; give one from 0 to 63",
    ),
    "no cell given": ({"select": ASK.CELL}, "Cell -1 does not exist"),
    "one entry": (
        {"descriptor": [0.5]},
        "The descriptor has 1 entries; this repertoire's has 2: "
        + ", ".join(SPEC.descriptor_names),
    ),
    "no descriptor": ({}, "The descriptor has 0 entries"),
    "descriptor NaN": ({"descriptor": [0.5, math.nan]}, "must be finite"),
    "distance NaN": ({"descriptor": [0.5, 0.5], "max_distance": math.nan}, "max_distance is NaN"),
    "fitness NaN": (
        {"select": ASK.BEST, "require_fitness": True, "min_fitness": math.nan},
        "min_fitness is NaN",
    ),
    "unknown way": ({"select": 9}, "select is 9; expected 0 (descriptor)"),
}


@pytest.mark.parametrize("case", NOT_FOUND)
def test_not_found_answers_have_a_reason(repertoire: Served, case: str) -> None:
    fields, words = NOT_FOUND[case]
    response = ask(repertoire, **fields)
    assert (response.found, words in response.message) == (False, True), response.message


def test_an_empty_cell_has_its_own_message(repertoire: Served) -> None:
    cell = int(np.flatnonzero(~repertoire.archive.filled)[0])
    message = ask(repertoire, select=ASK.CELL, cell=cell).message
    assert message == f"Cell {cell} is empty; choose a filled one, or the nearest to a descriptor."


@pytest.mark.parametrize(
    "fields", [{"descriptor": [0.5, 0.5]}, {"select": ASK.BEST}, {"select": ASK.RANDOM}]
)
def test_an_empty_repertoire_has_its_own_message(empty: Served, fields: dict[str, Any]) -> None:
    response = ask(empty, **fields)
    assert not response.found
    assert (
        response.message == "The repertoire is still empty; ask again after its first generation."
    )


def test_an_empty_repertoire_lists_nothing(empty: Served) -> None:
    response = ask_list(empty)
    assert (response.ok, response.total, len(response.behaviors)) == (True, 0, 0)


def test_an_empty_repertoire_has_metrics_before_the_first_generation(empty: Served) -> None:
    metrics = empty.probe.call(GetInfo, "repertoire/get_info").metrics
    assert (metrics.generation, metrics.coverage, metrics.cells) == (-1, 0, 64)
    assert math.isnan(metrics.max_fitness)


def test_pages_have_all_behaviors_fittest_first(repertoire: Served) -> None:
    pages = [ask_list(repertoire, offset=i, limit=5) for i in range(0, 20, 5)]
    fitness = [b.fitness for page in pages for b in page.behaviors]
    archive = repertoire.archive
    assert fitness == sorted(archive.fitness[archive.filled], reverse=True)
    assert {page.total for page in pages} == {archive.coverage}


def test_a_list_leaves_out_behaviors_that_are_not_fit_enough(repertoire: Served) -> None:
    archive = repertoire.archive
    least = float(np.nanmedian(archive.fitness))
    response = ask_list(repertoire, require_fitness=True, min_fitness=least)
    assert response.total == len(response.behaviors) == np.count_nonzero(archive.fitness >= least)


@pytest.mark.parametrize(
    "fields",
    [
        {"offset": -1},
        {"limit": 0},
        {"limit": 10_001},
        {"require_fitness": True, "min_fitness": math.nan},
    ],
)
def test_an_invalid_list_request_is_refused(repertoire: Served, fields: dict[str, Any]) -> None:
    response = ask_list(repertoire, **fields)
    assert not response.ok
    assert any(name in response.message for name in fields)


def test_get_info_describes_run_and_descriptor(repertoire: Served) -> None:
    info = repertoire.probe.call(GetInfo, "repertoire/get_info")
    assert (info.run_id, info.task, info.archive) == ("run-of-the-tests", "qd_walker", "cvt")
    assert tuple(info.descriptor_names) == SPEC.descriptor_names
    assert (list(info.descriptor_low), list(info.descriptor_high)) == ([0.0, 0.0], [1.0, 1.0])
    assert json.loads(info.settings) == SETTINGS.to_dict()
    assert (info.metrics.evaluations, info.growing) == (20, False)


def test_late_subscribers_get_the_metrics(repertoire: Served) -> None:
    heard = repertoire.probe.listen(Metrics, "repertoire/metrics", qos.LATCHED)
    wait_until(lambda: bool(heard), "the newest metrics")
    assert (heard[0].generation, heard[0].coverage) == (1, repertoire.archive.coverage)


@pytest.mark.parametrize("profile", ["latched", "volatile"])
def test_late_subscribers_get_the_picture(repertoire: Served, profile: str) -> None:
    quality = qos.LATCHED if profile == "latched" else qos.STATUS
    heard = repertoire.probe.listen(Image, "repertoire/heatmap", quality)
    wait_until(lambda: bool(heard), "a picture")
    picture = np.array(heard[0].data, np.uint8).reshape(heard[0].height, heard[0].width, 3)
    assert heard[0].encoding == "rgb8"
    # There are more colors than that of empty cells.
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 5


def test_the_map_shows_each_elite_in_its_place(repertoire: Served) -> None:
    heard = repertoire.probe.listen(OccupancyGrid, "repertoire/grid", qos.LATCHED)
    wait_until(lambda: bool(heard), "a map")
    info, archive = heard[0].info, repertoire.archive
    assert (heard[0].header.frame_id, info.origin.position.x) == ("repertoire", 0.0)
    assert info.width * info.resolution == pytest.approx(1.0)
    # The map's first cells are those of the lowest second descriptor.
    values = np.array(heard[0].data, np.int8).reshape(info.height, info.width)
    rows, columns = np.indices(values.shape)
    centers = (np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.5) * info.resolution
    fitness = archive.fitness[archive.cell_of(centers)]
    worst, best = archive.fitness[archive.filled].min(), archive.fitness[archive.filled].max()
    share = (fitness - worst) / (best - worst)
    expected = np.where(np.isnan(share), -1, np.rint(100 * np.nan_to_num(share)))
    assert np.array_equal(values.ravel(), expected)


def test_a_finished_file_has_no_services_of_the_loop(repertoire: Served) -> None:
    ask(repertoire, select=ASK.BEST)
    offered = {name for name, _ in repertoire.probe.node.get_service_names_and_types()}
    assert "/repertoire/get_behavior" in offered
    assert not {name for name in offered if name.startswith("/archive/")}


def test_a_behavior_is_served_without_simulator_or_torch(repertoire: Served) -> None:
    assert ask(repertoire, select=ASK.BEST).found
    mapped = Path(f"/proc/{repertoire.manager.process.pid}/maps").read_text()
    assert "rclpy" in mapped
    assert "libtorch" not in mapped
    assert "pybullet" not in mapped


def test_serving_does_not_change_the_file(tmp_path: Path) -> None:
    with served(tmp_path) as repertoire:
        before = repertoire.path.read_bytes()
        assert ask(repertoire, select=ASK.BEST).found
    assert repertoire.path.read_bytes() == before


def test_a_repertoire_can_live_in_a_namespace(repertoire: Served) -> None:
    graph = repertoire.graph
    graph.start("archive_manager", {"repertoire": repertoire.path}, "-r", "__ns:=/left")
    response = repertoire.probe.call(GetBehavior, "/left/repertoire/get_behavior", select=ASK.BEST)
    assert response.found


def test_a_run_serves_its_repertoire_while_it_continues(
    graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    run = graph.run(tmp_path / "run", evaluations=100_000)
    run.wait_for_output("evaluations 10/")
    assert probe.call(GetBehavior, "repertoire/get_behavior", select=ASK.BEST).found
    assert probe.call(GetInfo, "repertoire/get_info").growing
