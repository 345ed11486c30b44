"""Choosing behaviors: the k nearest, and by the means of re-evaluations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from graph import Probe
from pga_me_msgs.srv import GetBehavior, GetBehaviors, ListBehaviors
from stored import Served

from pga_me_ros.client import RepertoireClient
from pga_me_ros.core.storage.reevaluations import FILE, Reevaluations
from pga_me_ros.errors import RequestError

ASK = GetBehavior.Request
WANTED = [0.6, 0.4]
REPEATS = 4


@pytest.fixture(scope="module")
def client(repertoire: Served) -> Iterator[RepertoireClient]:
    probe = Probe(repertoire.graph.domain)
    yield RepertoireClient(probe.node)
    probe.close()


@pytest.fixture
def rows(repertoire: Served) -> Reevaluations:
    """Store re-evaluations of half of the elites during a test; the least fit elite does best in them."""
    archive = repertoire.archive
    cells = archive.filled_cells()[::2]
    evaluations = np.repeat(archive.evaluations[cells], REPEATS)
    rng = np.random.default_rng(7)
    rank = np.repeat(np.argsort(np.argsort(-archive.fitness[cells])), REPEATS)
    rows = Reevaluations(
        run_id="run-of-the-tests",
        evaluation=evaluations,
        repeat=np.tile(np.arange(REPEATS), len(cells)),
        fitness=100.0 * rank + rng.random(len(evaluations)),
        descriptor=rng.random((len(evaluations), 2)),
        steps=np.full(len(evaluations), 1000),
        terminated=np.zeros(len(evaluations), np.bool_),
    )
    rows.save(repertoire.path)
    return rows


def ask(repertoire: Served, **fields: Any) -> GetBehavior.Response:
    return repertoire.probe.call(GetBehavior, "repertoire/get_behavior", **fields)


def ask_many(repertoire: Served, **fields: Any) -> GetBehaviors.Response:
    return repertoire.probe.call(GetBehaviors, "repertoire/get_behaviors", **fields)


def by_distance(repertoire: Served) -> list[int]:
    """Return the filled cells, nearest to WANTED first."""
    cells = repertoire.archive.filled_cells()
    far = np.linalg.norm(repertoire.archive.descriptors[cells] - WANTED, axis=1)
    return cells[np.argsort(far, kind="stable")].tolist()


def test_the_nearest_are_returned_in_order_with_their_controllers(repertoire: Served) -> None:
    response = ask_many(repertoire, descriptor=WANTED, count=5)
    cells = [behavior.cell for behavior in response.behaviors]
    assert cells == by_distance(repertoire)[:5]
    got = np.array(response.parameters, np.float32).reshape(5, -1)
    assert np.array_equal(got, repertoire.archive.parameters[cells])
    assert list(response.controller.layer_sizes) == [22, 16, 16, 6]
    assert response.distances[0] == ask(repertoire, descriptor=WANTED).distance
    assert list(response.distances) == sorted(response.distances)


def test_controllers_can_be_omitted(repertoire: Served) -> None:
    response = ask_many(repertoire, descriptor=WANTED, count=3, with_controllers=False)
    assert (len(response.behaviors), len(response.parameters)) == (3, 0)


def test_limits_reduce_the_number_of_behaviors(repertoire: Served) -> None:
    archive = repertoire.archive
    least = float(np.nanmedian(archive.fitness))
    fit = [cell for cell in by_distance(repertoire) if archive.fitness[cell] >= least]
    response = ask_many(
        repertoire, descriptor=WANTED, count=1000, require_fitness=True, min_fitness=least
    )
    assert [behavior.cell for behavior in response.behaviors] == fit
    near = ask_many(
        repertoire, descriptor=WANTED, count=1000, max_distance=response.distances[2]
    ).behaviors
    assert {b.cell for b in near} == set(by_distance(repertoire)[: len(near)])
    assert fit[2] == near[-1].cell


def test_finding_none_within_the_limits_is_an_answer_with_a_reason(repertoire: Served) -> None:
    response = ask_many(repertoire, descriptor=[9.0, 9.0], count=3, max_distance=0.1)
    assert (response.ok, len(response.behaviors)) == (True, 0)
    assert "within 0.1 of" in response.message


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"descriptor": WANTED, "count": 0}, "count is 0; expected 1 to 1000"),
        ({"descriptor": WANTED, "count": 1001}, "count is 1001"),
        ({"descriptor": [0.5]}, "has 1 entries"),
        ({"descriptor": WANTED, "max_distance": math.nan}, "max_distance is NaN"),
        ({"descriptor": [math.nan, 0.0]}, "must be finite"),
    ],
)
def test_an_invalid_request_is_refused(
    repertoire: Served, fields: dict[str, Any], words: str
) -> None:
    response = ask_many(repertoire, **fields)
    assert (response.ok, words in response.message) == (False, True), response.message


def test_the_client_returns_controllers_that_run(
    repertoire: Served, client: RepertoireClient
) -> None:
    found = client.get_behaviors(WANTED, 4)
    assert [behavior.cell for behavior in found] == by_distance(repertoire)[:4]
    for behavior in found:
        single = client.get_behavior(cell=behavior.cell).controller
        assert behavior.controller(np.ones(22)).tobytes() == single(np.ones(22)).tobytes()
    assert client.get_behaviors(WANTED, 4, max_distance=1e-9) == ()
    with pytest.raises(RequestError, match="count is 2000"):
        client.get_behaviors(WANTED, 2000)


def test_the_best_by_mean_differs_from_the_best(repertoire: Served, rows: Reevaluations) -> None:
    mean = rows.fitness.reshape(-1, REPEATS).mean(axis=1)
    best = ask(repertoire, select=ASK.BEST, by_mean=True).behavior
    assert best.evaluation == rows.evaluation[REPEATS * mean.argmax()]
    assert best.mean_fitness == pytest.approx(mean.max(), rel=1e-12)
    assert best.repeats == REPEATS
    # The least fit of those re-evaluated has the best mean.
    assert best.fitness < repertoire.archive.max_fitness


def test_the_nearest_by_mean_has_the_nearest_mean_descriptor(
    repertoire: Served, rows: Reevaluations
) -> None:
    means = rows.descriptor.reshape(-1, REPEATS, 2).mean(axis=1)
    far = np.linalg.norm(means - WANTED, axis=1)
    response = ask_many(repertoire, descriptor=WANTED, count=3, by_mean=True)
    assert [b.evaluation for b in response.behaviors] == rows.evaluation[::REPEATS][
        np.argsort(far)[:3]
    ].tolist()
    np.testing.assert_allclose(response.distances, np.sort(far)[:3], rtol=1e-12)
    np.testing.assert_allclose(
        response.behaviors[0].descriptor_spread,
        rows.descriptor.reshape(-1, REPEATS, 2)[far.argmin()].std(axis=0, ddof=1),
        rtol=1e-12,
    )


def test_the_list_by_mean_has_those_re_evaluated_and_the_best_on_average_first(
    client: RepertoireClient, rows: Reevaluations
) -> None:
    means = rows.fitness.reshape(-1, REPEATS).mean(axis=1)
    best_first = rows.evaluation[::REPEATS][np.argsort(-means)].tolist()
    listed = [b.evaluation for b in client.list_behaviors(by_mean=True, page=7)]
    assert listed == best_first
    least = float(np.sort(means)[-3])
    listed = [b.evaluation for b in client.list_behaviors(by_mean=True, min_fitness=least)]
    assert listed == best_first[:3]


def test_the_answer_for_a_behavior_without_re_evaluations_says_so(
    repertoire: Served, client: RepertoireClient, rows: Reevaluations
) -> None:
    cell = int(repertoire.archive.filled_cells()[1])
    message = ask(repertoire, select=ASK.CELL, cell=cell, by_mean=True).message
    assert message == f"The behavior of cell {cell} was not re-evaluated."
    behavior = client.get_behavior(cell=cell)
    assert (behavior.repeats, len(behavior.mean_descriptor)) == (0, 0)
    assert math.isnan(behavior.mean_fitness)


def test_without_re_evaluations_by_mean_is_refused(repertoire: Served) -> None:
    repertoire.path.with_name(FILE).unlink(missing_ok=True)
    response = ask(repertoire, select=ASK.BEST, by_mean=True)
    assert not response.found
    assert "No behavior of this repertoire was re-evaluated" in response.message
    listed = repertoire.probe.call(ListBehaviors, "repertoire/list_behaviors", by_mean=True)
    assert (listed.ok, listed.total, listed.message) == (True, 0, response.message)


def test_foreign_re_evaluations_do_not_affect_other_requests(
    repertoire: Served, rows: Reevaluations
) -> None:
    replace(rows, run_id="another").save(repertoire.path)
    refused = ask(repertoire, select=ASK.BEST, by_mean=True)
    assert (refused.found, "is of run another" in refused.message) == (False, True)
    assert ask(repertoire, select=ASK.BEST).behavior.repeats == 0
