"""Moments of directional variation, Eq. 6."""

from __future__ import annotations

import numpy as np
import pytest

from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.core.variation.genetic import ga_variation
from pga_me_ros.errors import NetworkError, SettingsError

SHAPE = MlpShape((5, 8, 3))
RNG = np.random.default_rng(0)
PARENT1, PARENT2 = random_parameters(SHAPE, RNG), random_parameters(SHAPE, RNG)


def offspring(n, iso_sigma, line_sigma, line_noise="scalar", seed=1):
    rng = np.random.default_rng(seed)
    return np.stack(
        [
            ga_variation(PARENT1, PARENT2, iso_sigma, line_sigma, rng, SHAPE, line_noise)
            for _ in range(n)
        ]
    )


def line_steps(children):
    """Return the step along the line as a share of the way from parent 1 to parent 2, per parameter."""
    return (children - PARENT1.astype(np.float64)) / (PARENT2 - PARENT1)


def test_without_noise_the_offspring_is_the_first_parent():
    np.testing.assert_array_equal(offspring(1, 0.0, 0.0)[0], PARENT1)


def test_isotropic_part_has_mean_zero_deviation_sigma_1_and_no_correlation():
    children = offspring(20_000, 0.005, 0.0)
    noise = (children - PARENT1.astype(np.float64)) / 0.005
    assert abs(noise.mean()) < 0.005
    np.testing.assert_allclose(noise.std(axis=0), 1, atol=0.03)
    correlation = np.corrcoef(noise.T) - np.eye(SHAPE.parameter_count)
    assert np.abs(correlation).max() < 0.04


@pytest.mark.parametrize("line_noise", ["scalar", "tensor"])
def test_line_part_has_mean_zero_and_deviation_sigma_2(line_noise):
    steps = line_steps(offspring(20_000, 0.0, 0.05, line_noise)) / 0.05
    far_apart = np.abs(PARENT2 - PARENT1) > 0.1
    assert np.abs(steps[:, far_apart].mean(axis=0)).max() < 0.03
    np.testing.assert_allclose(steps[:, far_apart].std(axis=0), 1, atol=0.03)


def test_scalar_line_noise_is_one_step_for_all_parameters():
    steps = line_steps(offspring(50, 0.0, 0.5))
    far_apart = np.abs(PARENT2 - PARENT1) > 0.1
    assert np.ptp(steps[:, far_apart], axis=1).max() < 1e-5


def test_tensor_line_noise_is_one_step_per_weight_tensor():
    steps = line_steps(offspring(2000, 0.0, 0.5, "tensor"))
    far_apart = np.abs(PARENT2 - PARENT1) > 0.1
    firsts = []
    for tensor in SHAPE.slices():
        own = steps[:, tensor.span][:, far_apart[tensor.span]]
        assert np.ptp(own, axis=1).max() < 1e-5
        firsts.append(own[:, 0])
    assert np.abs(np.corrcoef(firsts) - np.eye(len(firsts))).max() < 0.1


def test_both_parts_add_up():
    variance = (offspring(20_000, 0.1, 0.5) - PARENT1.astype(np.float64)).var(axis=0)
    wanted = 0.1**2 + (0.5 * (PARENT2.astype(np.float64) - PARENT1)) ** 2
    np.testing.assert_allclose(variance / wanted, 1, atol=0.06)


def test_equal_generators_give_equal_bits():
    assert offspring(3, 0.1, 0.5).tobytes() == offspring(3, 0.1, 0.5).tobytes()


def test_offspring_is_float32_and_parents_are_unchanged():
    before = PARENT1.copy(), PARENT2.copy()
    assert offspring(1, 0.1, 0.5)[0].dtype == np.float32
    np.testing.assert_array_equal((PARENT1, PARENT2), before)


def test_a_parent_of_another_size_is_refused():
    with pytest.raises(NetworkError, match="belong to the same layer sizes"):
        ga_variation(PARENT1, PARENT2[:-1], 0.1, 0.1, RNG, SHAPE)


def test_unknown_line_noise_is_refused():
    with pytest.raises(SettingsError, match="'scalar' or 'tensor'"):
        ga_variation(PARENT1, PARENT2, 0.1, 0.1, RNG, SHAPE, "vector")
