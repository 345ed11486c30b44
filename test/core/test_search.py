"""The whole algorithm in one process on a task that a gradient solves at once."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from graph_in_small import GraphInSmall
from lane_task import SETTINGS, Lane, grown
from operator_counts import per_operator

from pga_me_ros.core.archive.elites import NO_PARENT
from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import random_parameters
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.search import Batch, Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import ArchiveError, RequestError
from pga_me_ros.tasks.rollout import Episode, rollout

BRIEF = SETTINGS.replace(n_crit=10, evaluations=70)
"""Long enough for every kind of training to happen at least twice."""


@pytest.fixture(scope="module")
def whole():
    return grown()


def evaluated(search: Search, batch: Batch) -> list[Episode]:
    task = Lane()
    return [
        rollout(task, MlpController(search.shape, p), evaluation_rng(search.settings.seed, k))
        for k, p in zip(batch.evaluations, batch.parameters, strict=True)
    ]


def test_training_twice_gives_the_same_bits(whole):
    again = grown()
    assert again.archive.digest() == whole.archive.digest()
    assert again.metrics == whole.metrics


def test_another_seed_gives_another_repertoire():
    assert grown(BRIEF.replace(seed=4)).archive.digest() != grown(BRIEF).archive.digest()


def test_the_archive_fills(whole):
    assert whole.archive.coverage == whole.archive.cells


def test_gradients_find_what_genetic_variation_does_not(whole):
    ga_only = grown(SETTINGS.replace(n_evo=SETTINGS.batch_size))
    best = Lane.spec.max_steps
    assert whole.archive.max_fitness > 0.995 * best
    assert whole.archive.mean_fitness > 0.9 * best
    assert ga_only.archive.mean_fitness < 0.85 * best


def test_without_gradients_no_critic_is_trained():
    search = grown(BRIEF.replace(n_evo=BRIEF.batch_size))
    assert search.learner.version == 0
    assert search.metrics[-1].offspring == per_operator(ga=10)


def test_critics_train_for_every_generation_of_offspring(whole):
    trained = (
        SETTINGS.generations - SETTINGS.init_generations + 1
    )  # the last one is for a resumed run
    assert whole.learner.version == trained * SETTINGS.n_crit


def test_metrics_count_what_was_evaluated(whole):
    assert [m.evaluations for m in whole.metrics] == list(range(10, 161, 10))
    assert [m.offspring for m in whole.metrics[:3]] == [
        per_operator(random=10),
        per_operator(random=10),
        per_operator(ga=5, pg=4, greedy=1),
    ]


def test_parents_are_elites_of_earlier_generations(whole):
    search = grown(BRIEF, generations=3)
    batch = search.ask()
    elites = set(search.archive.evaluations[search.archive.filled_cells()].tolist())
    parents = {
        operator: batch.parents[batch.operators == operator]
        for operator in (Operator.GA, Operator.PG)
    }
    assert set(parents[Operator.GA].ravel().tolist()) <= elites
    assert set(parents[Operator.PG][:, 0].tolist()) <= elites
    assert (parents[Operator.PG][:, 1] == NO_PARENT).all()
    assert (batch.parents[batch.operators == Operator.GREEDY] == NO_PARENT).all()


def test_telling_a_batch_twice_is_refused():
    search = Search(Lane.spec, BRIEF)
    batch = search.ask()
    episodes = evaluated(search, batch)
    search.tell(batch, episodes)
    with pytest.raises(RequestError, match="Generation 0 was told, but 1 comes next"):
        search.tell(batch, episodes)


def test_episodes_that_do_not_fit_the_batch_are_refused():
    search = Search(Lane.spec, BRIEF)
    batch = search.ask()
    with pytest.raises(ArchiveError):
        search.tell(batch, evaluated(search, batch)[:-1])


@pytest.mark.parametrize(
    "changes",
    [
        {"schedule": "alternating"},
        {"critic_start": "last_init_batch"},
        {"greedy_init": "best"},
        {"greedy_takes": "ga"},
        {"pg_batches": "own"},
        {"archive": "grid", "cells": Settings.cells, "cvt_samples": Settings.cvt_samples},
        {"line_noise": "tensor"},
        {"terminal": "bootstrap", "discount": 0.9},
        {"target_action": "free", "discount": 0.9},
    ],
    ids=lambda c: "-".join(map(str, next(iter(c.items())))),
)
def test_every_departure_changes_the_run_and_keeps_it_reproducible(changes, tmp_path):
    settings = BRIEF.replace(**changes)
    plain = settings.replace(**{k: getattr(BRIEF, k) for k in changes if k != "discount"})
    one = grown(settings)
    assert one.archive.digest() != grown(plain).archive.digest()
    graph = GraphInSmall(settings, tmp_path)
    graph.grow(range(settings.generations))
    assert one.archive.digest() == graph.archive.digest()


def first_greedy(search: Search) -> np.ndarray:
    """Return the greedy controller of the first generation with gradients; the search is just before it."""
    batch = search.ask()
    return batch.parameters[batch.operators == Operator.GREEDY][0]


def test_greedy_controller_may_start_from_the_best_random_one():
    still = BRIEF.replace(greedy_init="best", greedy_learning_rate=0.0)
    search = grown(still, generations=still.init_generations)
    np.testing.assert_array_equal(first_greedy(search), search.archive.best().parameters)


def test_greedy_controller_starts_at_random_by_default():
    still = BRIEF.replace(greedy_learning_rate=0.0)
    search = grown(still, generations=still.init_generations)
    drawn = random_parameters(search.shape, generator(still.seed, Purpose.CRITIC_INIT, 0, 2))
    np.testing.assert_array_equal(first_greedy(search), drawn)


def test_start_in_the_last_random_batch_trains_on_the_experience_before_it():
    """The last random batch does not affect the first critics: another one gives the same."""
    early = BRIEF.replace(critic_start="last_init_batch")
    searches = [grown(early, generations=1) for _ in range(2)]
    for search, scale in zip(searches, (1.0, 0.5), strict=True):
        batch = search.ask()
        batch = dataclasses.replace(batch, parameters=batch.parameters * np.float32(scale))
        search.tell(batch, evaluated(search, batch))
    assert first_greedy(searches[0]).tobytes() == first_greedy(searches[1]).tobytes()


def test_budget_can_be_raised(whole):
    search = grown(SETTINGS.replace(evaluations=70))
    task = Lane()
    search.settings = SETTINGS
    while search.generation < search.settings.generations:
        search.run_generation(task)
    assert search.archive.digest() == whole.archive.digest()


def test_changed_variation_rates_apply_from_the_next_generation():
    search, unchanged = grown(BRIEF, generations=3), grown(BRIEF, generations=3)
    search.settings = BRIEF.replace(iso_sigma=0.0, line_sigma=0.0, pg_learning_rate=0.0, n_evo=2)
    batch = search.ask()
    assert np.bincount(batch.operators).tolist() == [0, 2, 7, 1]
    by_evaluation = {e.evaluation: e.parameters for e in search.archive.elites()}
    for place in np.flatnonzero(batch.operators != Operator.GREEDY):
        parent = by_evaluation[int(batch.parents[place, 0])]
        np.testing.assert_array_equal(batch.parameters[place], parent)
    assert unchanged.ask().parameters.tobytes() != batch.parameters.tobytes()


def test_changed_critic_rates_apply_to_the_training_that_the_next_generation_starts():
    search = grown(BRIEF, generations=3)
    before = search.learner.version
    search.settings = BRIEF.replace(n_crit=17)
    task = Lane()
    search.run_generation(task)
    assert search.learner.version == before + 17


def test_rates_changed_during_the_run_give_the_same_result_in_the_graph(tmp_path):
    off = BRIEF.replace(n_evo=10)
    changed = BRIEF.replace(n_evo=3, n_crit=7, n_grad=4, discount=0.5, iso_sigma=0.1)
    rates = {3: changed, 4: off, 6: changed}
    search, task = Search(Lane.spec, BRIEF), Lane()
    for t in range(BRIEF.generations):
        search.settings = rates.get(t, search.settings)
        search.run_generation(task)
    graph = GraphInSmall(BRIEF, tmp_path, rates)
    graph.grow(range(BRIEF.generations))
    assert search.archive.digest() == graph.archive.digest()
