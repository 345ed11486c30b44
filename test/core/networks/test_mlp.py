"""Controllers: layout, checks, random ones, and the forward pass compared with float64."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape, random_critic, random_parameters
from pga_me_ros.core.networks.shapes import controller_shape, critic_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import NetworkError

WALKER = MlpShape((22, 128, 128, 6))


@dataclass(frozen=True)
class Walker:
    observation_dim: int = 22
    action_dim: int = 6


def forward64(shape, parameters, observation):
    """Compute the forward pass in float64, following the documented layout."""
    flat, signal, offset = parameters.astype(np.float64), observation.astype(np.float64), 0
    for layer in range(1, len(shape.sizes)):
        n_in, n_out = shape.sizes[layer - 1 : layer + 1]
        weights = flat[offset : offset + n_in * n_out].reshape(n_out, n_in)
        offset += n_in * n_out
        signal = weights @ signal + flat[offset : offset + n_out]
        offset += n_out
        signal = np.tanh(signal) if layer == len(shape.sizes) - 1 else np.maximum(signal, 0)
    return signal


def test_parameter_count_of_table_1():
    assert WALKER.parameter_count == 22 * 128 + 128 + 128 * 128 + 128 + 128 * 6 + 6


def test_slices_follow_each_other_and_cover_the_vector():
    tensors = MlpShape((3, 4, 2)).slices()
    assert [(t.offset, t.shape) for t in tensors] == [
        (0, (4, 3)),
        (12, (4,)),
        (16, (2, 4)),
        (24, (2,)),
    ]


def test_shapes_come_from_task_and_settings():
    settings = Settings(controller_hidden=(16,), critic_hidden=(32, 8))
    assert controller_shape(Walker(), settings).sizes == (22, 16, 6)
    assert critic_shape(Walker(), settings).sizes == (28, 32, 8, 1)


@pytest.mark.parametrize("sizes", [(5,), (), (3, 0, 2), (-1, 2)])
def test_invalid_layer_sizes_are_refused(sizes):
    with pytest.raises(NetworkError, match="make no network"):
        MlpShape(sizes)


def test_wrong_parameter_count_is_refused_with_both_numbers():
    with pytest.raises(NetworkError, match=r"\(7,\).*\(26,\)"):
        MlpShape((3, 4, 2)).check(np.zeros(7, np.float32))


@pytest.mark.parametrize("wrong", [np.zeros(26), [0.0] * 26])
def test_parameters_that_are_not_float32_are_refused(wrong):
    with pytest.raises(NetworkError, match="not float32"):
        MlpShape((3, 4, 2)).check(wrong)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_parameters_that_are_not_finite_are_refused(value):
    parameters = np.zeros(26, np.float32)
    parameters[17] = value
    with pytest.raises(NetworkError, match="Parameter 17"):
        MlpController(MlpShape((3, 4, 2)), parameters)


@pytest.mark.parametrize("sizes", [(22, 128, 128, 6), (28, 128, 128, 8), (5, 2), (4, 7, 3)])
def test_action_equals_float64_forward_pass(sizes):
    rng = np.random.default_rng(1)
    shape = MlpShape(sizes)
    parameters = random_parameters(shape, rng)
    controller = MlpController(shape, parameters)
    for _ in range(20):
        observation = rng.uniform(-5, 5, sizes[0]).astype(np.float32)
        wanted = forward64(shape, parameters, observation)
        np.testing.assert_allclose(controller(observation), wanted, rtol=0, atol=5e-6)


def test_action_has_the_same_bits_whatever_ran_before_and_wherever_the_parameters_are():
    rng = np.random.default_rng(2)
    parameters = random_parameters(WALKER, rng)
    shifted = np.empty(len(parameters) + 3, np.float32)[3:]
    shifted[:] = parameters
    used, fresh = MlpController(WALKER, parameters), MlpController(WALKER, shifted)
    observation = rng.standard_normal(22).astype(np.float32)
    for _ in range(5):
        used(rng.standard_normal(22).astype(np.float32))
    assert used(observation).tobytes() == fresh(observation).tobytes()


def test_action_is_float32_and_unchanged_by_the_next_call():
    controller = MlpController(WALKER, random_parameters(WALKER, np.random.default_rng(3)))
    first = controller(np.ones(22, np.float32))
    kept = first.copy()
    controller(-np.ones(22, np.float32))
    assert first.dtype == np.float32
    np.testing.assert_array_equal(first, kept)


def test_controller_keeps_its_own_parameters():
    parameters = random_parameters(WALKER, np.random.default_rng(4))
    controller = MlpController(WALKER, parameters)
    before = controller(np.ones(22, np.float32))
    parameters[:] = 0
    np.testing.assert_array_equal(controller(np.ones(22, np.float32)), before)


def test_random_weights_fill_the_xavier_range():
    weights, biases = WALKER.layers(random_parameters(WALKER, np.random.default_rng(5)))[1]
    limit = np.sqrt(6 / 256)
    assert 0.99 * limit < np.abs(weights).max() <= limit
    assert abs(weights.var() / (limit**2 / 3) - 1) < 0.05
    assert 0.9 / np.sqrt(128) < np.abs(biases).max() <= 1 / np.sqrt(128)


def test_random_critic_fills_the_default_range_of_torch():
    shape = MlpShape((28, 256, 256, 1))
    weights, _ = shape.layers(random_critic(shape, np.random.default_rng(6)))[1]
    assert 0.99 / 16 < np.abs(weights).max() <= 1 / 16
