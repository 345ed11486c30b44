"""Choosing behaviors: the k nearest, and by the means of re-evaluations."""

from __future__ import annotations

import math
import signal
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from graph import Probe
from pga_me_msgs.srv import GetBehavior, GetBehaviors, ListBehaviors
from stored import Served

from pga_me_ros.client import BehaviorNotFoundError, RepertoireClient
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


@pytest.fixture
def plain(repertoire: Served) -> Served:
    """The repertoire without re-evaluations."""
    repertoire.path.with_name(FILE).unlink(missing_ok=True)
    return repertoire


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


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({"by_mean": True}, "by_mean"),
        ({"max_fall_share": 0.1}, "max_fall_share"),
        ({"by_mean": True, "max_fall_share": 0.1}, "by_mean and max_fall_share"),
    ],
)
def test_foreign_re_evaluations_do_not_affect_other_requests(
    repertoire: Served, rows: Reevaluations, asked: dict[str, Any], named: str
) -> None:
    replace(rows, run_id="another").save(repertoire.path)
    refused = ask(repertoire, select=ASK.BEST, **asked)
    assert (refused.found, "is of run another" in refused.message) == (False, True)
    assert refused.message.startswith(f"{named} cannot be answered: ")
    assert ask(repertoire, select=ASK.BEST).behavior.repeats == 0


def test_a_manager_says_at_its_start_that_the_re_evaluations_are_damaged(
    repertoire: Served,
) -> None:
    file = repertoire.path.with_name(FILE)
    file.write_text("no arrays")
    try:
        values = {"repertoire": repertoire.path}
        manager = repertoire.graph.start("archive_manager", values, "-r", "__ns:=/damaged")
        manager.wait_for_output(f"what they are worth on average is unknown: '{file}' is damaged")
        manager.signal(signal.SIGINT)
        assert manager.wait() == 0
    finally:
        file.unlink()


def test_the_mean_counts_where_there_is_one_and_the_answer_says_so(
    repertoire: Served, client: RepertoireClient, rows: Reevaluations
) -> None:
    mean = rows.fitness.reshape(-1, REPEATS).mean(axis=1)
    best = ask(repertoire, select=ASK.BEST).behavior
    assert (best.by_mean, best.mean_fitness) == (True, pytest.approx(mean.max(), rel=1e-12))
    single = ask(repertoire, select=ASK.BEST, single=True).behavior
    assert (single.by_mean, single.fitness) == (False, repertoire.archive.max_fitness)
    cell = int(repertoire.archive.filled_cells()[1])
    unknown = client.get_behavior(cell=cell)
    assert (unknown.by_mean, unknown.promised_fitness) == (False, unknown.fitness)
    judged = client.get_behavior(best=True)
    assert (judged.by_mean, judged.promised_fitness) == (True, judged.mean_fitness)
    assert judged.promised_descriptor.tolist() == judged.mean_descriptor.tolist()
    listed = list(client.list_behaviors())
    assert len(listed) == repertoire.archive.coverage
    promised = [behavior.promised_fitness for behavior in listed]
    assert promised == sorted(promised, reverse=True)


def test_a_share_of_falls_can_be_demanded(
    repertoire: Served, client: RepertoireClient, rows: Reevaluations
) -> None:
    fell = np.zeros(len(rows.fitness), np.bool_)
    fell[REPEATS:] = True
    fell[REPEATS] = False
    replace(rows, terminated=fell).save(repertoire.path)
    never, seldom = rows.evaluation[0], rows.evaluation[REPEATS]
    found = client.get_behavior(best=True, max_fall_share=0.0)
    assert (found.evaluation, found.fall_share) == (never, 0.0)
    few = {b.evaluation for b in client.get_behaviors(WANTED, 9, max_fall_share=0.75)}
    assert (
        few == {never, seldom} == {b.evaluation for b in client.list_behaviors(max_fall_share=0.8)}
    )
    with pytest.raises(BehaviorNotFoundError, match=r"cell \d+ was not re-evaluated; at most 50 %"):
        client.get_behavior(cell=int(repertoire.archive.filled_cells()[1]), max_fall_share=0.5)
    with pytest.raises(RequestError, match="max_fall_share is 2; give a share from 0 to 1"):
        client.get_behavior(best=True, max_fall_share=2)


def test_a_least_fitness_counts_by_itself(plain: Served) -> None:
    response = ask(plain, descriptor=WANTED, min_fitness=99_999.0)
    assert not response.found
    assert response.message.startswith("No behavior has a fitness of 99999.0 or more; the best has")
    assert "The nearest is that of cell" in response.message
    none = ask_many(plain, descriptor=WANTED, min_fitness=99_999.0)
    assert (none.ok, len(none.behaviors)) == (True, 0)
    listed = plain.probe.call(ListBehaviors, "repertoire/list_behaviors", min_fitness=99_999.0)
    assert (listed.ok, listed.total) == (True, 0)
    assert "No behavior has a fitness of 99999.0" in listed.message
    least = float(plain.archive.fitness[plain.archive.filled].min())
    assert ask(plain, descriptor=WANTED, min_fitness=least).found
    assert not ask(plain, select=ASK.BEST, min_fitness=plain.archive.max_fitness + 1).found


def test_what_is_too_far_is_named_and_not_given(plain: Served) -> None:
    response = ask(plain, descriptor=[9.0, 9.0], max_distance=0.1)
    assert (response.found, response.behavior.steps) == (False, 0)
    nearest = ask(plain, descriptor=[9.0, 9.0])
    assert f"The nearest is that of cell {nearest.behavior.cell}, {nearest.distance:.3f} away" in (
        response.message
    )


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"select": ASK.BEST, "descriptor": WANTED}, "descriptor given, but select is 2 (best)"),
        ({"select": ASK.BEST, "cell": 3}, "cell given, but select is 2 (best)"),
        ({"cell": 3, "descriptor": WANTED}, "cell given, but select is 0 (descriptor)"),
        ({"select": ASK.RANDOM, "max_distance": 0.1}, "max_distance given, but select is 3"),
        ({"select": ASK.BEST, "require_fitness": True}, "min_fitness is not given"),
        ({"select": ASK.BEST, "by_mean": True, "single": True}, "contradict each other"),
        ({"select": ASK.BEST, "max_fall_share": 1.5}, "max_fall_share is 1.5; give a share"),
        ({"select": ASK.BEST, "max_fall_share": math.nan}, "max_fall_share is nan"),
        ({"select": ASK.BEST, "min_fitness": math.nan}, "min_fitness is NaN"),
        ({"select": 9}, "select is 9; expected 0 (descriptor)"),
    ],
)
def test_what_a_request_names_counts_or_is_refused(
    repertoire: Served, fields: dict[str, Any], words: str
) -> None:
    response = ask(repertoire, **fields)
    assert (response.found, words in response.message) == (False, True), response.message


def test_a_request_can_leave_the_controller_out(plain: Served, client: RepertoireClient) -> None:
    response = ask(plain, descriptor=WANTED, with_controller=False)
    assert response.found
    assert (len(response.controller.parameters), len(response.controller.layer_sizes)) == (0, 0)
    found = client.find_behavior(descriptor=WANTED)
    assert (found.cell, found.distance) == (response.behavior.cell, response.distance)
    nearest = client.find_behaviors(WANTED, 3)
    assert [b.cell for b in nearest] == by_distance(plain)[:3]
    assert not hasattr(nearest[0], "controller")
