"""Conversions between messages and the core's types, and what they refuse."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from pga_me_msgs.msg import Transitions

from pga_me_ros.core.archive.elites import Elite
from pga_me_ros.core.archive.metrics import Metrics
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.errors import NetworkError, RequestError
from pga_me_ros.ros import convert
from pga_me_ros.tasks.registry import task_spec
from pga_me_ros.tasks.rollout import Episode

SPEC = task_spec("qd_hopper")
STEPS = 7
RNG = np.random.default_rng(0)
EPISODE = Episode(
    states=RNG.normal(size=(STEPS + 1, SPEC.observation_dim)).astype(np.float32),
    actions=RNG.normal(size=(STEPS, SPEC.action_dim)).astype(np.float32),
    rewards=RNG.normal(size=STEPS).astype(np.float32),
    fitness=0.1 + 0.2,
    descriptor=np.array([1.0 / 3.0]),
    terminated=True,
)
IDS = {"run_id": "r", "task": "qd_hopper", "evaluator": "/e", "generation": 2, "evaluation": 31}
CRITIC, GREEDY = MlpShape((18, 5, 1)), MlpShape((15, 5, 3))
SNAPSHOT = Snapshot(
    generation=4,
    version=1200,
    networks={
        "critic": (CRITIC, random_parameters(CRITIC, RNG)),
        "greedy": (GREEDY, random_parameters(GREEDY, RNG)),
    },
    states=RNG.normal(size=(2, 3, 4, 15)).astype(np.float32),
    transitions=900,
    critic_loss=0.25,
    mean_q=-3.5,
)
ES_SNAPSHOT = replace(
    SNAPSHOT,
    networks={
        "greedy": SNAPSHOT.network("greedy"),
        "center": (GREEDY, random_parameters(GREEDY, RNG)),
    },
    states=np.empty((0, 0, 0, 0), np.float32),
    transitions=0,
)
INFO = RunInfo("r", Settings().to_dict(), SPEC.to_json(), (15, 8, 3), ("relu", "tanh"), {}, "now")


def transitions(**changes: Any) -> Transitions:
    msg = convert.episode_to_msg(EPISODE, **IDS)
    for name, value in changes.items():
        setattr(msg, name, value)
    return msg


def assert_same_fields(got: Any, expected: Any) -> None:
    for name, value in vars(expected).items():
        other = getattr(got, name)
        if isinstance(value, np.ndarray):
            assert (other.dtype, other.shape) == (value.dtype, value.shape), name
            assert other.tobytes() == value.tobytes(), name
        elif name == "networks":
            assert list(other) == list(value)
            for key, (shape, parameters) in value.items():
                assert other[key][0] == shape
                assert other[key][1].dtype == parameters.dtype
                assert other[key][1].tobytes() == parameters.tobytes()
        else:
            assert other == value, name


def test_an_episode_is_converted_bit_for_bit() -> None:
    assert_same_fields(convert.episode_from_msg(transitions(), SPEC), EPISODE)


def test_an_episode_carries_what_it_was_meant_to_achieve() -> None:
    aimed = replace(EPISODE, intended=np.array([2.0 / 3.0]))
    back = convert.episode_from_msg(convert.episode_to_msg(aimed, **IDS), SPEC)
    assert_same_fields(back, aimed)
    assert back.intended is not None


def test_an_episode_carries_its_ids() -> None:
    assert {name: getattr(transitions(), name) for name in IDS} == IDS


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"observation_dim": 14}, r"dimensions \(14, 3, 1\), task 'qd_hopper' has \(15, 3, 1\)"),
        ({"descriptor": [0.5, 0.5]}, r"dimensions \(15, 3, 2\)"),
        ({"steps": 0}, "has 0 steps; expected 1 to 1000"),
        ({"steps": 1001}, "has 1001 steps"),
        ({"steps": STEPS + 1}, "'states' has 120 entries"),
        ({"rewards": convert.flat([0.0] * 6, "f")}, "'rewards' has 6 entries"),
        ({"actions": convert.flat([math.nan] * 21, "f")}, "'actions' holds NaN"),
        ({"states": convert.flat([math.inf] * 120, "f")}, "'states' holds NaN or infinity"),
        ({"descriptor": [math.nan]}, "'descriptor' holds NaN"),
        ({"fitness": math.nan}, "'fitness' holds NaN"),
        ({"intended_descriptor": [0.5, 0.5]}, "'intended_descriptor' has 2 entries"),
        ({"intended_descriptor": [math.inf]}, "'intended_descriptor' holds NaN or infinity"),
    ],
)
def test_a_malformed_episode_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(RequestError, match=words):
        convert.episode_from_msg(transitions(**changes), SPEC)


DIVERSE = replace(
    SNAPSHOT,
    networks={**SNAPSHOT.networks, "diversity_critic": (CRITIC, random_parameters(CRITIC, RNG))},
)
NUMBERS = CRITIC.parameter_count + GREEDY.parameter_count


@pytest.mark.parametrize(
    "snapshot", [SNAPSHOT, ES_SNAPSHOT, DIVERSE], ids=["critics", "evolution", "diversity"]
)
def test_a_snapshot_is_converted_bit_for_bit(snapshot: Snapshot) -> None:
    back = convert.snapshot_from_msg(convert.snapshot_to_msg(snapshot, "r"))
    assert_same_fields(back, snapshot)


@pytest.mark.parametrize(
    ("field", "value", "error", "words"),
    [
        ("n_grad", 4, RequestError, "'states' has 360 entries"),
        ("batch_size", -4, RequestError, "'states' has 360 entries"),
        ("layer_sizes", [18, 5, 1, 15, 6, 3], NetworkError, r"layers \[15, 6, 3\] take \(117,\)"),
        ("layer_sizes", [18, 5, 1, 15, 4, 3], RequestError, "has 199 entries, .* take 180"),
        ("layer_sizes", [], RequestError, "has 0 entries, but 'layer_counts' adds up to 6"),
        ("layer_counts", [7, -1], RequestError, "has 6 entries"),
        ("layer_counts", [3], RequestError, "have 2 and 1 entries"),
        ("networks", ["critic", "critic"], RequestError, "1 names differ"),
        ("networks", [], RequestError, "have 0 and 2 entries"),
        ("parameters", convert.flat([math.nan] * NUMBERS, "f"), NetworkError, "0 is nan"),
        ("parameters", convert.flat([0.5] * (NUMBERS - 1), "f"), NetworkError, r"shape \(97,\)"),
        ("parameters", convert.flat([0.5] * (NUMBERS + 1), "f"), RequestError, "has 200 entries"),
    ],
)
def test_a_malformed_snapshot_is_refused(field: str, value: Any, error: type, words: str) -> None:
    msg = convert.snapshot_to_msg(SNAPSHOT, "r")
    setattr(msg, field, value)
    with pytest.raises(error, match=words):
        convert.snapshot_from_msg(msg)


def test_rates_are_applied_to_other_settings() -> None:
    ours = Settings(n_evo=7, discount=0.5, target_period=3)
    back = convert.with_rates(Settings(seed=9), convert.rates_to_msg(ours))
    assert {n: getattr(back, n) for n in RATES} == {n: getattr(ours, n) for n in RATES}
    assert back.seed == 9


def test_rates_out_of_range_are_refused() -> None:
    msg = convert.rates_to_msg(Settings())
    msg.discount = 1.5
    with pytest.raises(RequestError, match="discount"):
        convert.with_rates(Settings(), msg)


@pytest.mark.parametrize(
    ("operator", "parents", "made_by"),
    [
        (Operator.PG, (5, -1), "pg"),
        (Operator.GA, (5, 8), "ga"),
        (Operator.RANDOM, (-1, -1), "random"),
    ],
)
def test_an_elite_has_the_name_of_its_operator(
    operator: Operator, parents: tuple[int, int], made_by: str
) -> None:
    elite = Elite(
        3, 1.5, np.array([0.25]), np.zeros(2, np.float32), 40, 4, operator, *parents, 9, True
    )
    msg = convert.behavior_to_msg(elite)
    assert (msg.made_by, list(msg.parents)) == (
        made_by,
        [p for p in parents if p >= 0],
    )
    assert (msg.cell, msg.fitness, list(msg.descriptor), msg.steps) == (3, 1.5, [0.25], 9)


def test_metrics_sum_over_operators() -> None:
    metrics = Metrics(
        4, 500, 30, 0.3, 12.5, 3.0, 0.5, 900, 4000, (0, 50, 49, 1), (0, 3, 4, 0), (0, 1, 2, 1)
    )
    msg = convert.metrics_to_msg(metrics, INFO, 100)
    assert (msg.run_id, msg.task, msg.cells, msg.coverage) == ("r", "qd_hopper", 100, 30)
    assert (msg.new_elites, msg.improved_elites, msg.evaluations, msg.steps) == (7, 4, 500, 900)


def test_an_archive_without_generations_has_metrics_too() -> None:
    msg = convert.metrics_to_msg(None, INFO, 100)
    assert (msg.generation, msg.evaluations, msg.coverage) == (-1, 0, 0)
    assert math.isnan(msg.max_fitness)


def test_a_controller_names_the_unit_of_every_number() -> None:
    shape = MlpShape((SPEC.observation_dim, 4, SPEC.action_dim))
    parameters = random_parameters(shape, np.random.default_rng(0))
    msg = convert.controller_to_msg(parameters, shape, SPEC)
    assert msg.observation_units[:3] == ["m above start", "1", "1"]
    assert list(msg.action_units) == ["75 N·m"] * 3


def test_a_picture_keeps_its_pixels_and_rows() -> None:
    rgb = RNG.integers(0, 256, (4, 5, 3), np.uint8)
    msg = convert.image_to_msg(rgb, Time(sec=7))
    assert (msg.height, msg.width, msg.step, msg.encoding) == (4, 5, 15, "rgb8")
    assert (msg.data.tobytes(), msg.header.stamp.sec) == (rgb.tobytes(), 7)


def test_shapes_with_negative_dimensions_fit_nothing() -> None:
    with pytest.raises(RequestError, match="dimensions"):
        convert.shaped([1.0, 2.0, 3.0, 4.0], (-2, -2), np.float64, "x")
