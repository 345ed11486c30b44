"""Extract-MAP-Elites in the loop: a share of each batch is evaluated again, whatever the algorithm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from lane_task import SETTINGS, Lane, grown

from pga_me_ros.core.algorithms import ALGORITHMS
from pga_me_ros.core.algorithms.qd_rl.selection import pareto_parents
from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.plan import GenerationPlan
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.rules import RULES, useless
from pga_me_ros.errors import RequestError, SettingsError
from pga_me_ros.tasks.rollout import rollout

ABLE = [name for name in ALGORITHMS if RULES[name].uses("extract_share")]


def settings(**changes: Any) -> Settings:
    """Return settings of a short search in which three of ten are evaluated again."""
    values = {**SETTINGS.given, "extract_share": 0.3, "cell_depth": 2, "evaluations": 60, **changes}
    unused = useless(values, str(values.get("algorithm", "pga_map_elites")), "cvt")
    return Settings.from_mapping({n: v for n, v in values.items() if n not in unused})


def test_every_algorithm_with_critics_has_it() -> None:
    assert {name for name, a in ALGORITHMS.items() if a.learns_critics} <= set(ABLE) | {
        "map_elites_es",
        "map_elites",
    }
    assert {"pga_map_elites", "pg_only", "td3", "qd_rl", "map_elites"} <= set(ABLE)


@pytest.mark.parametrize("name", [n for n in ABLE if n != "qd_rl"])
def test_a_share_of_each_batch_after_the_random_ones_is_evaluated_again(name: str) -> None:
    s = settings(algorithm=name)
    for generation in range(s.generations):
        slots = GenerationPlan.of(s, s, generation).slots
        places = [k for slot in slots for k in range(slot.first, slot.first + slot.count)]
        assert places == list(range(s.batch_size))
        again = sum(slot.count for slot in slots if slot.operator == Operator.EXTRACTED)
        assert again == (3 if generation >= s.init_generations else 0)


def test_genetic_variation_keeps_its_share_of_what_is_new() -> None:
    slots = GenerationPlan.of(settings(n_evo=10, batch_size=20), settings(), 9).slots
    counts = {slot.operator: slot.count for slot in slots}
    assert counts == {
        Operator.GREEDY: 1,
        Operator.GA: 7,
        Operator.PG: 6,
        Operator.EXTRACTED: 6,
    }


@pytest.mark.parametrize("share", [0.25, 0.3, 0.5])
@pytest.mark.parametrize("name", ABLE)
def test_a_run_that_resumes_with_stored_rates_plans_what_it_planned(
    name: str, share: float
) -> None:
    s = Settings(algorithm=name, extract_share=share, cell_depth=2)
    assert s.with_rates(s.rates) == s
    (plan, resumed) = (GenerationPlan.of(x, x, 200).slots for x in (s, s.with_rates(s.rates)))
    assert resumed == plan


def test_critics_that_are_trained_make_offspring() -> None:
    s = Settings(n_evo=99, extract_share=0.5)
    counts = {slot.operator: slot.count for slot in GenerationPlan.of(s, s, 9).slots}
    assert counts == {Operator.GREEDY: 1, Operator.GA: 49, Operator.EXTRACTED: 50}


def test_qd_rl_takes_as_many_parents_from_the_fronts_as_are_needed() -> None:
    s = Settings(algorithm="qd_rl", extract_share=0.5)
    archive = grown(settings()).archive
    chosen = ALGORITHMS["qd_rl"].choose_parents(archive, s, 9, 0, 2, 1)
    rng = generator(s.seed, Purpose.QDRL_SELECTION, 9)
    np.testing.assert_array_equal(
        chosen[:, 0], pareto_parents(archive, s.novelty_neighbors, rng, 2)
    )
    with pytest.raises(RequestError, match="places 0 to 1 have one parent each"):
        ALGORITHMS["qd_rl"].choose_parents(archive, s, 9, 0, 3, 1)


@pytest.mark.parametrize("name", [n for n in ABLE if n != "qd_rl"])
def test_the_same_seed_gives_the_same_repertoire(name: str) -> None:
    s = settings(algorithm=name)
    one, other = grown(s), grown(s)
    assert one.archive.digest() == other.archive.digest()
    assert one.depth is not None
    assert other.depth is not None
    assert one.depth.samples.keys() == other.depth.samples.keys()
    assert max(sample.count for sample in one.depth.samples.values()) > 1
    assert one.archive.digest() != grown(settings(algorithm=name, seed=4)).archive.digest()


def test_an_elite_has_the_mean_of_its_evaluations() -> None:
    s = settings()
    search, task = Search(Lane.spec, s), Lane()
    seen: dict[int, list[float]] = {}
    while search.generation < s.generations:
        batch = search.ask()
        episodes = [
            rollout(task, MlpController(search.shape, p), evaluation_rng(s.seed, k))
            for k, p in zip(batch.evaluations, batch.parameters, strict=True)
        ]
        for place, episode in enumerate(episodes):
            again = batch.operators[place] == Operator.EXTRACTED
            key = batch.parents[place, 0] if again else batch.evaluations[place]
            seen.setdefault(int(key), []).append(episode.fitness)
        search.tell(batch, episodes)
    archive = search.archive
    several = 0
    for cell in archive.filled_cells().tolist():
        values = seen[int(archive.evaluations[cell])]
        several += len(values) > 1
        assert archive.fitness[cell] == pytest.approx(np.mean(values), rel=1e-12)
    assert several


def test_off_is_the_algorithm_as_it_was() -> None:
    plain = Settings.from_mapping(SETTINGS.given)
    search = Search(Lane.spec, plain)
    assert (search.depth, plain.extracted) == (None, 0)
    assert all(
        slot.operator != Operator.EXTRACTED
        for slot in GenerationPlan.of(plain, plain, plain.generations - 1).slots
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"extract_share": 0.0}, "cell_depth is 2, but extract_share is 0"),
        ({"extract_share": 0.01}, "is 0 of a batch of 10 controllers"),
        ({"extract_share": 0.9}, "is 9 of a batch of 10 controllers"),
        ({"extract_share": 1.5}, "extract_share is 1.5; expected a value from"),
        ({"extract_share": -0.1}, "extract_share is -0.1; expected a value from"),
        ({"cell_depth": 0}, "cell_depth is 0; expected a value from 1"),
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        settings(**changes)


def test_an_algorithm_that_has_no_use_for_it_refuses_it() -> None:
    with pytest.raises(
        SettingsError, match=r"extract_share is 0\.3, but map_elites_es doesn't use"
    ):
        Settings(algorithm="map_elites_es", extract_share=0.3)
