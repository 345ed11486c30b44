"""The archive manager of a run: adding, drawing parents, refusals, and files that it cannot serve."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph import Graph, wait_until
from nav_msgs.msg import OccupancyGrid
from pga_me_msgs.msg import Elites, Metrics
from pga_me_msgs.srv import AddToArchive, GetBehavior, GetInfo, SampleParents
from sensor_msgs.msg import Image
from stored import SETTINGS, B, Served, parameters, served, solutions, store, to_add

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.elites import Status
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import flat, rates_to_msg

ADD, SAMPLE = "archive/add", "archive/sample_parents"


@pytest.fixture(scope="module")
def growing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Serve an archive of one generation that waits for the second."""
    with served(tmp_path_factory.mktemp("growing"), generations=1, grow=True) as repertoire:
        yield repertoire


def generation_1(**changes: Any) -> dict[str, Any]:
    """Return the fields of the request that adds the second generation."""
    return {**to_add(1, solutions(1)), **changes}


def sample(**changes: Any) -> dict[str, Any]:
    fields = {"run_id": "run-of-the-tests", "generation": 1, "first": 2, "count": 3}
    return {**fields, "parents_each": 2, **changes}


def listen_to_elites(repertoire: Served) -> list[Elites]:
    """Return a list to which messages published from now on are added."""
    heard = repertoire.probe.listen(Elites, names.ELITES, qos.ELITES)
    wait_until(lambda: repertoire.probe.node.count_publishers(names.ELITES) > 0, "the topic")
    return heard


def assert_elites(msg: Elites, archive: Archive) -> None:
    cells = list(msg.cells)
    assert list(msg.evaluations) == archive.evaluations[cells].tolist()
    assert np.array_equal(np.array(msg.parameters), archive.parameters[cells].ravel())


def digest(repertoire: Served) -> str:
    with Repertoire.open(repertoire.path, read_only=True) as file:
        return file.result_digest()


def no_rates() -> Any:
    rates = rates_to_msg(SETTINGS)
    rates.n_evo = 11
    return rates


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "another run": (
        {"run_id": "stray"},
        "is for run 'stray', but this node works for run 'run-of-the",
    ),
    "a generation left out": ({"generation": 2}, "has all up to 0, so the next is 1"),
    "a negative generation": ({"generation": -1}, "Generation -1 cannot be added"),
    "too few": ({"fitness": flat(np.zeros(9), "d")}, "'fitness' has 9 entries"),
    "descriptors too long": (
        {"descriptors": flat(np.zeros(30), "d")},
        "'descriptors' has 30 entries",
    ),
    "parameters too short": ({"parameters": flat(np.zeros(7), "f")}, "'parameters' has 7 entries"),
    "fitness NaN": ({"fitness": flat(np.full(B, np.nan), "d")}, "'fitness' holds NaN"),
    "descriptor infinite": (
        {"descriptors": flat(np.full(20, np.inf), "d")},
        "'descriptors' holds NaN",
    ),
    "parameter NaN": ({"parameters": flat(parameters(1) * np.nan, "f")}, "'parameters' holds NaN"),
    "no such operator": (
        {"operators": [max(Operator) + 1] * B},
        f"'operators' holds {max(Operator) + 1}; expected 0 to {max(Operator):d}",
    ),
    "no such parent": ({"parents": flat(np.full(20, -2), "q")}, "'parents' holds -2"),
    "an episode of no steps": ({"steps": flat(np.zeros(B), "q")}, "'steps' holds 0; expected 1"),
    "rates out of range": ({"rates": no_rates()}, "n_evo is 11"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_stray_generation_is_refused_and_changes_nothing(growing: Served, case: str) -> None:
    changes, words = REFUSED[case]
    before = digest(growing)
    response = growing.probe.call(AddToArchive, ADD, **generation_1(**changes))
    assert (response.accepted, words in response.message) == (False, True), response.message
    assert growing.probe.call(GetInfo, "repertoire/get_info").metrics.generation == 0
    assert digest(growing) == before


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"run_id": "stray"}, "is for run 'stray'"),
        ({"generation": 2}, "so the next is 1"),
        ({"generation": 0}, "Parents of generation 0 are asked for"),
        ({"count": 0}, "expected 1 to 10 offspring"),
        ({"count": 11}, "expected 1 to 10 offspring"),
        ({"first": -1}, "first -1"),
        ({"parents_each": 3}, "parents_each is 3; expected 1 or 2"),
    ],
)
def test_an_invalid_draw_is_refused(growing: Served, changes: dict[str, Any], words: str) -> None:
    response = growing.probe.call(SampleParents, SAMPLE, **sample(**changes))
    assert (response.accepted, words in response.message) == (False, True), response.message


def test_parents_equal_those_drawn_in_one_process(growing: Served) -> None:
    response = growing.probe.call(SampleParents, SAMPLE, **sample())
    cells = algorithm_of(SETTINGS).choose_parents(growing.archive, SETTINGS, 1, 2, 3, 2)
    assert np.array_equal(response.evaluations, growing.archive.evaluations[cells].ravel())


def test_parents_are_published_again_on_request(growing: Served) -> None:
    heard = listen_to_elites(growing)
    response = growing.probe.call(SampleParents, SAMPLE, **sample(publish=True))
    wait_until(lambda: bool(heard), "the parents")
    assert (heard[0].run_id, heard[0].generation) == ("run-of-the-tests", 0)
    assert set(heard[0].evaluations) == set(response.evaluations)
    assert_elites(heard[0], growing.archive)


def test_adding_a_generation_gives_the_same_archive_as_in_one_process(tmp_path: Path) -> None:
    with served(tmp_path, generations=1, grow=True) as growing:
        heard = listen_to_elites(growing)
        response = growing.probe.call(AddToArchive, ADD, **generation_1())
        added = growing.archive.add(solutions(1))
        assert response.accepted, response.message
        wait_until(lambda: bool(heard), "the new elites")
        assert (heard[0].generation, list(heard[0].cells)) == (1, added.changed_cells.tolist())
        assert_elites(heard[0], growing.archive)
        names = [Status(status).name for status in added.status]
        assert {"NEW", "IMPROVED", "REJECTED"} == set(names)
        assert list(response.status) == [getattr(AddToArchive.Request, name) for name in names]
        assert digest(growing) == growing.archive.digest()
        assert response.metrics.coverage == growing.archive.coverage


def test_a_generation_sent_twice_counts_once(tmp_path: Path) -> None:
    with served(tmp_path, generations=1, grow=True) as growing:
        first = growing.probe.call(AddToArchive, ADD, **generation_1())
        before = digest(growing)
        again = growing.probe.call(AddToArchive, ADD, **generation_1())
        first.metrics.stamp = again.metrics.stamp
        # As text, in which what is not known equals itself.
        assert (again.accepted, str(again.metrics)) == (True, str(first.metrics))
        assert digest(growing) == before


def test_the_answer_for_an_older_generation_is_repeated(tmp_path: Path) -> None:
    with served(tmp_path, generations=2, grow=True) as growing:
        old = growing.probe.call(AddToArchive, ADD, **generation_1(generation=0))
        assert (old.accepted, old.metrics.generation, old.metrics.evaluations) == (True, 0, B)
        assert growing.probe.call(GetInfo, "repertoire/get_info").metrics.generation == 1


def test_metrics_and_pictures_are_updated_with_the_archive(tmp_path: Path) -> None:
    with served(tmp_path, generations=1, grow=True) as growing:
        metrics = growing.probe.listen(Metrics, "repertoire/metrics", qos.LATCHED)
        pictures = growing.probe.listen(Image, "repertoire/heatmap", qos.LATCHED)
        maps = growing.probe.listen(OccupancyGrid, "repertoire/grid", qos.LATCHED)
        wait_until(lambda: bool(metrics and pictures and maps), "the first metrics and pictures")
        seen, first = len(pictures), maps[-1].data
        growing.probe.call(AddToArchive, ADD, **generation_1())
        wait_until(lambda: metrics[-1].generation == 1, "metrics of the second generation")
        wait_until(lambda: pictures[-1].data != pictures[seen - 1].data, "a new picture")
        wait_until(lambda: maps[-1].data != first, "a new map")


def test_a_generation_is_served_as_soon_as_it_is_added(tmp_path: Path) -> None:
    with served(tmp_path, generations=0, grow=True) as growing:
        growing.probe.call(AddToArchive, ADD, **{**generation_1(), "generation": 0})
        answer = growing.probe.call(GetBehavior, "repertoire/get_behavior", select=2)
        assert answer.behavior.fitness == solutions(1).fitness.max()


def cut_off(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def other_schema(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA user_version = 99")
    connection.close()


def other_file(path: Path) -> None:
    path.write_text("not a database, whatever its name says\n")


def bit_flipped(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute(
        "UPDATE elites SET fitness = fitness + 1 WHERE cell = (SELECT min(cell) FROM elites)"
    )
    connection.commit()
    connection.close()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (Path.unlink, "There is no repertoire"),
        (cut_off, "damaged"),
        (other_schema, "schema version 99"),
        (other_file, "is not a repertoire file"),
        (bit_flipped, "damaged"),
    ],
)
def test_a_file_that_cannot_be_served_gives_one_line(
    graph: Graph, tmp_path: Path, spoil: Callable[[Path], None], words: str
) -> None:
    path = tmp_path / "repertoire.db"
    store(path)
    spoil(path)
    manager = graph.start("archive_manager", {"repertoire": path})
    assert manager.wait() == 2
    (line,) = manager.output.splitlines()
    assert line.startswith("error: ")
    assert words in line


def test_no_file_at_all_gives_one_line(graph: Graph) -> None:
    manager = graph.start("archive_manager", {})
    assert manager.wait() == 2
    (line,) = manager.output.splitlines()
    assert "-p repertoire:=RUN_DIR/repertoire.db" in line
