"""Conditioned networks: descriptors scaled by hand, and folded networks that do what the whole ones do."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest

from pga_me_ros.core.networks.conditioned import (
    ConditionedActor,
    ConditionedDimensions,
    conditions,
    folded,
    scaled,
)
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape, random_critic, random_parameters
from pga_me_ros.errors import NetworkError


@dataclass(frozen=True)
class Robot:
    observation_dim: int = 15
    action_dim: int = 3
    descriptor_low: tuple[float, ...] = (0.0, -2.0)
    descriptor_high: tuple[float, ...] = (1.0, 6.0)


OBS, ACT = Robot.observation_dim, Robot.action_dim
RNG = np.random.default_rng(0)
ACTOR = MlpShape((OBS + 2, 128, 128, ACT))
CRITIC = MlpShape((OBS + 2 + ACT, 64, 32, 1))
PARAMETERS = random_parameters(ACTOR, RNG)
Q1 = random_critic(CRITIC, RNG)
OBSERVATIONS = RNG.standard_normal((50, OBS)).astype(np.float32)
WANTED = RNG.uniform(Robot.descriptor_low, Robot.descriptor_high, (9, 2))


def values64(shape, parameters, inputs):
    """Return what a critic gives inputs, in float64."""
    signal = inputs.astype(np.float64)
    *hidden, (weights, biases) = shape.layers(parameters.astype(np.float64))
    for w, b in hidden:
        signal = np.maximum(signal @ w.T + b, 0.0)
    return signal @ weights.T + biases


@pytest.mark.parametrize(
    ("descriptor", "expected"),
    [
        ([0.0, -2.0], [-1.0, -1.0]),
        ([1.0, 6.0], [1.0, 1.0]),
        ([0.5, 2.0], [0.0, 0.0]),
        ([0.75, 0.0], [0.5, -0.5]),
        ([-0.1, 7.0], [-1.0, 1.0]),
    ],
)
def test_descriptors_are_scaled_by_the_bounds_of_the_task(descriptor, expected):
    np.testing.assert_allclose(scaled(descriptor, Robot()), expected, rtol=0, atol=1e-15)
    several = conditions(np.array([descriptor, descriptor]), Robot())
    assert several.dtype == np.float32
    np.testing.assert_array_equal(several, np.float32([expected, expected]))


@pytest.mark.parametrize("descriptor", [[0.5], [0.5, 0.5, 0.5], 0.5, [0.5, np.nan], [np.inf, 0.5]])
def test_what_is_no_descriptor_of_the_task_is_refused(descriptor):
    with pytest.raises(NetworkError, match="expected 2 finite numbers"):
        scaled(descriptor, Robot())
    with pytest.raises(NetworkError, match="expected 2 finite numbers"):
        ConditionedActor(Robot(), ACTOR, PARAMETERS).at(descriptor)


def test_a_folded_actor_acts_as_the_conditioned_one():
    whole = MlpController(ACTOR, PARAMETERS)
    shape, plain = folded(ACTOR, PARAMETERS, OBS, conditions(WANTED, Robot()))
    assert shape.sizes == (OBS, 128, 128, ACT)
    for wanted, parameters in zip(conditions(WANTED, Robot()), plain, strict=True):
        act = MlpController(shape, parameters)
        for observation in OBSERVATIONS:
            expected = whole(np.concatenate([observation, wanted]))
            np.testing.assert_allclose(act(observation), expected, rtol=0, atol=2e-6)


def test_a_folded_critic_values_as_the_conditioned_one():
    actions = RNG.uniform(-1, 1, (50, ACT)).astype(np.float32)
    shape, plain = folded(CRITIC, Q1, OBS, conditions(WANTED, Robot()))
    assert shape.sizes == (OBS + ACT, 64, 32, 1)
    for wanted, parameters in zip(conditions(WANTED, Robot()), plain, strict=True):
        there = np.hstack([OBSERVATIONS, np.tile(wanted, (50, 1)), actions])
        expected = values64(CRITIC, Q1, there)
        got = values64(shape, parameters, np.hstack([OBSERVATIONS, actions]))
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-6)


def test_the_descriptor_makes_a_difference():
    _, plain = folded(ACTOR, PARAMETERS, OBS, conditions(WANTED, Robot()))
    assert len(np.unique(plain, axis=0)) == len(WANTED)


def test_each_folded_network_has_the_same_bits_alone():
    all_at_once = folded(CRITIC, Q1, OBS, conditions(WANTED, Robot()))[1]
    for i, wanted in enumerate(WANTED):
        alone = folded(CRITIC, Q1, OBS, conditions(wanted[None], Robot()))[1]
        assert alone[0].tobytes() == all_at_once[i].tobytes()


@pytest.mark.parametrize(("first", "n"), [(-1, 2), (16, 2), (0, 17)])
def test_inputs_that_are_not_there_cannot_be_fixed(first, n):
    with pytest.raises(NetworkError, match="cannot be fixed in layers"):
        folded(ACTOR, PARAMETERS, first, np.zeros((1, n), np.float32))


def test_an_actor_takes_the_descriptor_as_it_is_meant():
    actor = ConditionedActor(Robot(), ACTOR, PARAMETERS)
    whole = MlpController(ACTOR, PARAMETERS)
    for wanted in WANTED:
        plain = actor.at(wanted)
        assert plain.shape.sizes == (OBS, 128, 128, ACT)
        for observation in OBSERVATIONS[:5]:
            seen = np.concatenate([observation, conditions(wanted[None], Robot())[0]])
            np.testing.assert_array_equal(actor(observation, wanted), whole(seen))
            np.testing.assert_allclose(
                plain(observation), actor(observation, wanted), rtol=0, atol=2e-6
            )


def test_an_actor_in_task_units_acts_as_the_conditioned_one():
    actor = ConditionedActor(Robot(), ACTOR, PARAMETERS)
    own = MlpController(ACTOR, actor.in_task_units())
    for wanted in [*WANTED, Robot.descriptor_low, Robot.descriptor_high]:
        for observation in OBSERVATIONS:
            seen = np.concatenate([observation, np.float32(wanted)])
            np.testing.assert_allclose(own(seen), actor(observation, wanted), rtol=0, atol=5e-6)
    np.testing.assert_array_equal(actor.parameters, PARAMETERS)


def test_the_scaling_of_one_neuron_by_hand():
    shape = MlpShape((OBS + 2, 1))
    parameters = np.zeros(shape.parameter_count, np.float32)
    parameters[OBS : OBS + 3] = (
        1.0,
        8.0,
        0.5,
    )  # weights of a range 0..1 and one of -2..6, and the bias
    robot = dataclasses.replace(Robot(), action_dim=1)
    own = ConditionedActor(robot, shape, parameters).in_task_units()
    assert not own[:OBS].any()
    np.testing.assert_allclose(own[OBS:], [2.0, 2.0, 0.5 - 1.0 - 8.0 * 0.5])


def test_an_actor_keeps_its_parameters():
    given = PARAMETERS.copy()
    actor = ConditionedActor(Robot(), ACTOR, given)
    before = actor(OBSERVATIONS[0], WANTED[0])
    given[:] = 0.0
    np.testing.assert_array_equal(actor(OBSERVATIONS[0], WANTED[0]), before)
    np.testing.assert_array_equal(actor.parameters, PARAMETERS)


@pytest.mark.parametrize("sizes", [(OBS, 8, ACT), (OBS + 2, 8, ACT + 1)])
def test_an_actor_of_another_robot_is_refused(sizes):
    shape = MlpShape(sizes)
    with pytest.raises(NetworkError, match=r"does not fit the task; expected 17 inputs"):
        ConditionedActor(Robot(), shape, np.zeros(shape.parameter_count, np.float32))


def test_a_robots_descriptor_counts_as_part_of_its_observation():
    seen = ConditionedDimensions.of(Robot())
    assert (seen.observation_dim, seen.action_dim) == (OBS + 2, ACT)
