"""MAP-Elites-ES as a whole: its generations, its result on an easy task, and reproducibility."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from graph_in_small import GraphInSmall
from lane_task import SETTINGS, Lane, grown, learner_bits

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.algorithms.map_elites_es.learner import EsLearner
from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.search import Batch, Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.variation.make_offspring import OffspringRequest, make_offspring
from pga_me_ros.errors import PgaError, RequestError, SettingsError, StorageError
from pga_me_ros.tasks.rollout import Episode, rollout

ES = Settings(
    task="lane_task:Lane",
    algorithm="map_elites_es",
    seed=3,
    evaluations=61 * 40,
    cells=16,
    cvt_samples=500,
    controller_hidden=(8,),
    es_samples=60,
    es_sigma=0.1,
    es_learning_rate=0.1,
    es_steps=5,
)
SHORT = ES.replace(es_samples=10, batch_size=11, es_steps=2, evaluations=11 * 9)


def evaluated(batch: Batch) -> list[Episode]:
    """Return a batch's episodes."""
    shape, task = controller_shape(Lane.spec, SHORT), Lane()
    return [
        rollout(task, MlpController(shape, p), evaluation_rng(SHORT.seed, k))
        for k, p in zip(batch.evaluations, batch.parameters, strict=True)
    ]


@pytest.fixture(scope="module")
def search() -> Search:
    return grown(ES)


def test_it_reaches_the_optimum(search: Search):
    assert search.archive.max_fitness > 0.95 * Lane.spec.max_steps
    assert search.metrics[0].max_fitness < 0.9 * Lane.spec.max_steps


def test_it_fills_cells(search: Search):
    assert search.archive.coverage >= 12


def test_samples_count_but_do_not_enter_the_archive(search: Search):
    metrics = search.metrics[-1]
    assert metrics.evaluations == 61 * 40
    assert metrics.offspring[Operator.ES_SAMPLE] == 60
    assert metrics.offspring[Operator.GREEDY] == 1
    made_by = {elite.operator for elite in search.archive.elites()}
    assert made_by <= {Operator.RANDOM, Operator.GREEDY}
    assert Operator.GREEDY in made_by


def test_a_generation_is_one_controller_and_mirrored_pairs_around_it():
    search, task = Search(Lane.spec, SHORT), Lane()
    for generation in range(3):
        batch = search.ask()
        assert batch.operators.tolist()[0] == (Operator.GREEDY if generation else Operator.RANDOM)
        assert set(batch.operators.tolist()[1:]) == {Operator.ES_SAMPLE}
        assert (batch.parents == -1).all()
        middles = (batch.parameters[1::2] + batch.parameters[2::2]) / 2
        if generation < SHORT.es_steps:
            np.testing.assert_allclose(middles, np.tile(batch.parameters[0], (5, 1)), atol=1e-6)
        search.run_generation(task)


def test_after_its_steps_the_center_is_evaluated_and_samples_surround_an_elite():
    search, task = Search(Lane.spec, SHORT), Lane()
    for _ in range(SHORT.es_steps):
        search.run_generation(task)
    elites = search.archive.parameters[search.archive.filled_cells()]
    batch = search.ask()
    middle = (batch.parameters[1] + batch.parameters[2]) / 2
    assert np.abs(elites - middle).max(axis=1).min() < 1e-6
    assert np.abs(batch.parameters[0] - middle).max() > 1e-3


def test_exploit_and_explore_take_turns():
    search, task = Search(Lane.spec, SHORT), Lane()
    turns = []
    for _ in range(9):
        search.run_generation(task)
        search.ask()
        turns.append(bool(search.learner.state()["explore"][0]))
    assert turns == [False, True, True, False, False, True, True, False, False]


@pytest.mark.parametrize("explore", [False, True])
def test_steps_climb_fitness_or_novelty(explore: bool):
    """One direction along a line is fitter, the other leads away from a known behavior."""
    settings = ES.replace(es_l2=0.0)
    batch = Search(Lane.spec, settings).ask()
    along = np.random.default_rng(0).normal(size=batch.parameters.shape[1])
    way = (batch.parameters - batch.parameters[0]) @ along
    way /= np.abs(way).max()
    episodes = [
        replace(e, fitness=-float(x), descriptor=np.array([0.5 + 0.4 * x]))
        for e, x in zip(evaluated(Search(Lane.spec, SHORT).ask())[:1] * 61, way, strict=True)
    ]
    learner = EsLearner(Lane.spec, settings)
    known = {"explore": np.array([explore]), "behaviors": np.zeros((1, 1))}
    learner.load_state({**learner.state(), **known}, 0)
    learner.add(0, episodes)
    step = (learner.train(settings, 1).parameters("greedy") - batch.parameters[0]) @ along
    assert np.sign(step) == (1 if explore else -1)
    assert abs(step) > 0.2 * settings.es_learning_rate * np.abs(along).sum()


def test_it_knows_the_elites_of_the_archive(search: Search):
    search.ask()  # the step on the newest generation
    state, archive = search.learner.state(), search.archive
    cells = archive.filled_cells()
    assert state["elite_cells"].tolist() == cells.tolist()
    assert (state["elite_centers"] == archive.parameters[cells]).all()
    assert (state["elite_fitness"] == archive.fitness[cells]).all()
    assert (state["elite_generations"] == archive.generations[cells]).all()
    assert len(state["behaviors"]) == search.generation


def test_the_same_seed_gives_the_same_bits_and_another_seed_others():
    one, same, other = (grown(SHORT.replace(seed=seed)) for seed in (3, 3, 4))
    assert one.archive.digest() == same.archive.digest()
    assert one.metrics == same.metrics
    assert learner_bits(one.learner.state()) == learner_bits(same.learner.state())
    assert one.archive.digest() != other.archive.digest()


@pytest.mark.parametrize(
    "change", [{"es_cell_sampling": "plain"}, {"es_l2": 0.1}, {"es_neighbors": 1}], ids=str
)
def test_settings_have_an_effect(change: dict[str, Any]):
    longer = SHORT.replace(evaluations=11 * 20)
    assert grown(longer.replace(**change)).archive.digest() != grown(longer).archive.digest()


@pytest.mark.parametrize(("restarts", "late"), [((), ()), ((3, 6), ()), (range(9), range(9))])
def test_pieces_files_and_restarts_change_nothing(tmp_path: Path, restarts, late):
    graph = GraphInSmall(SHORT, tmp_path)
    graph.grow(range(SHORT.generations), restarts, late)
    assert graph.archive.digest() == grown(SHORT).archive.digest()


def test_from_a_stored_state_it_continues_bit_for_bit():
    search = grown(SHORT, 5)
    search.ask()
    copy = EsLearner(Lane.spec, SHORT)
    copy.load_state(search.learner.state(), search.learner.version)
    for generation in range(5, 9):
        batch = search.ask()
        episodes = evaluated(batch)
        search.tell(batch, episodes)
        copy.add(generation, episodes)
        snapshot = copy.train(SHORT, generation + 1)
        assert (search.ask().parameters[0] == snapshot.parameters("greedy")).all()
    assert learner_bits(copy.state()) == learner_bits(search.learner.state())
    assert copy.version == search.learner.version == 9


def test_it_learns_only_from_what_is_stored_of_an_episode():
    episode = evaluated(Search(Lane.spec, SHORT).ask())[1]
    short = algorithm_of(SHORT).remembered(episode)
    assert short.length == 1 < episode.length
    assert short == replace(
        episode, states=short.states, actions=short.actions, rewards=short.rewards
    )
    assert short.states.base is None


def test_a_step_needs_the_results_of_the_generation_before():
    learner = EsLearner(Lane.spec, SHORT)
    with pytest.raises(PgaError, match="needs the results"):
        learner.train(SHORT, 1)
    learner.add(0, evaluated(Search(Lane.spec, SHORT).ask()))
    with pytest.raises(PgaError, match="those of 0 are here"):
        learner.train(SHORT, 2)
    learner.forget_experience()
    with pytest.raises(PgaError, match="needs the results"):
        learner.train(SHORT, 1)


@pytest.mark.parametrize(
    ("name", "array"),
    [
        ("center", np.zeros(3, np.float32)),
        ("adam_mean", None),
        ("behaviors", np.zeros((4, 2))),
        ("elite_centers", np.zeros((1, 3), np.float32)),
        ("elite_cells", np.zeros(1)),
    ],
)
def test_a_state_of_another_run_is_refused_and_changes_nothing(name, array):
    learner = grown(SHORT, 3).learner
    before = learner_bits(learner.state())
    damaged = dict(learner.state())
    if array is None:
        del damaged[name]
    else:
        damaged[name] = array
    with pytest.raises(StorageError, match=name):
        learner.load_state(damaged, 2)
    assert learner_bits(learner.state()) == before


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"batch_size": 50}, "batch_size is 50"),
        ({"es_samples": 7}, "es_samples is 7"),
        ({"random_init": 20}, "random_init is 20"),
        ({"n_evo": 10}, "n_evo is 10"),
        ({"start_from": "runs/x"}, "start_from is 'runs/x'"),
        ({"greedy_init": "best"}, "greedy_init is 'best'"),
        ({"critic_start": "last_init_batch"}, "critic_start"),
        ({"replay_size": 3000}, "replay_size is 3000"),
        ({"es_sigma": 0.0}, "es_sigma is 0.0"),
    ],
)
def test_settings_that_contradict_it_are_refused(values: dict[str, Any], named: str):
    with pytest.raises(SettingsError, match=named):
        Settings(algorithm="map_elites_es", **values)


def test_its_batch_follows_from_its_samples():
    assert Settings(algorithm="map_elites_es").batch_size == 1001
    assert Settings(algorithm="map_elites_es").generations == 1000
    assert Settings.from_stored(ES.to_dict()) == ES
    with pytest.raises(SettingsError, match="pga_map_elites doesn't use it; remove es_samples"):
        Settings(es_samples=7)


def test_offspring_of_other_algorithms_are_refused():
    search, theirs = grown(SHORT, 2), grown(SETTINGS, 3)
    shape = search.shape
    none = np.empty((1, 1, shape.parameter_count), np.float32)
    with pytest.raises(RequestError, match="no network 'critic'"):
        make_offspring(Operator.PG, OffspringRequest(SHORT, shape, 1, 1, 1, none, search._snapshot))
    with pytest.raises(RequestError, match="no network 'center'"):
        make_offspring(
            Operator.ES_SAMPLE, OffspringRequest(SETTINGS, shape, 2, 1, 1, none, theirs._snapshot)
        )
    for first, count in ((0, 1), (10, 2)):
        with pytest.raises(RequestError, match="samples have places 1 to 10"):
            make_offspring(
                Operator.ES_SAMPLE, OffspringRequest(SHORT, shape, 0, first, count, none)
            )
