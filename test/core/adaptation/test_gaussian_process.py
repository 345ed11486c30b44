"""The Gaussian process is that of scikit-learn with the same kernel."""

from __future__ import annotations

import numpy as np
import pytest

from pga_me_ros.core.adaptation.gaussian_process import (
    averaged_posterior,
    log_likelihood,
    matern52,
    posterior,
)


@pytest.mark.parametrize("variance", [1.0, 0.09])
@pytest.mark.parametrize(("count", "dimensions"), [(1, 1), (7, 2), (20, 4)])
def test_mean_and_deviation_are_those_of_scikit_learn(
    count: int, dimensions: int, variance: float
) -> None:
    rng = np.random.default_rng(count)
    points, tried = rng.random((50, dimensions)), rng.random((count, dimensions))
    tried[-1] = tried[0]  # a behavior that was tried twice
    observed = rng.normal(size=count)
    sklearn = pytest.importorskip("sklearn.gaussian_process")
    kernel = sklearn.kernels.ConstantKernel(variance) * sklearn.kernels.Matern(0.4, nu=2.5)
    oracle = sklearn.GaussianProcessRegressor(kernel, alpha=0.001, optimizer=None)
    oracle.fit(tried, observed)
    means, deviations = posterior(points, tried, observed, 0.4, 0.001, variance)
    expected_means, expected_deviations = oracle.predict(points, return_std=True)
    np.testing.assert_allclose(means, expected_means, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(deviations, expected_deviations, rtol=1e-6, atol=1e-6)


def test_without_observations_all_is_prior() -> None:
    means, deviations = posterior(np.zeros((3, 2)), np.empty((0, 2)), np.empty(0), 0.4, 0.001)
    assert means.tolist() == [0.0, 0.0, 0.0]
    assert deviations.tolist() == [1.0, 1.0, 1.0]


def test_a_point_that_is_observed_again_and_again_keeps_a_deviation() -> None:
    tried = np.zeros((200, 1))
    _, deviations = posterior(np.zeros((1, 1)), tried, np.ones(200), 0.4, 1e-9)
    assert 0.0 <= deviations[0] < 1e-4
    assert matern52(tried[:1], tried[:1], 0.4) == 1.0


@pytest.mark.parametrize("variance", [1.0, 0.09])
@pytest.mark.parametrize("length_scale", [0.02, 0.4])
def test_the_likelihood_is_that_of_scikit_learn(length_scale: float, variance: float) -> None:
    rng = np.random.default_rng(0)
    tried, observed = rng.random((8, 2)), rng.normal(size=8)
    sklearn = pytest.importorskip("sklearn.gaussian_process")
    kernel = sklearn.kernels.ConstantKernel(variance) * sklearn.kernels.Matern(length_scale, nu=2.5)
    oracle = sklearn.GaussianProcessRegressor(kernel, alpha=0.001, optimizer=None)
    expected = oracle.fit(tried, observed).log_marginal_likelihood()
    assert log_likelihood(tried, observed, length_scale, 0.001, variance) == pytest.approx(expected)


def test_before_the_first_observation_all_length_scales_count_alike_and_all_is_prior() -> None:
    nothing = np.empty((0, 2)), np.empty(0)
    assert log_likelihood(*nothing, 0.1, 0.001) == 0.0
    means, deviations = averaged_posterior(np.zeros((3, 2)), *nothing, [0.02, 0.4], 0.001)
    assert means.tolist() == [0.0, 0.0, 0.0]
    assert deviations.tolist() == [1.0, 1.0, 1.0]


def test_one_length_scale_is_averaged_to_itself() -> None:
    rng = np.random.default_rng(1)
    given = rng.random((9, 1)), rng.random((4, 1)), rng.normal(size=4)
    averaged = averaged_posterior(*given, [0.3], 0.001)
    np.testing.assert_allclose(averaged, posterior(*given, 0.3, 0.001), rtol=1e-12)


@pytest.mark.parametrize(
    ("observed", "nearest"), [([-1.0, -1.0, -1.0], 0.4), ([-1.0, 0.0, -1.0], 0.02)]
)
def test_what_neighbors_achieve_decides_which_length_scale_counts(
    observed: list[float], nearest: float
) -> None:
    tried, points = np.array([[0.4], [0.5], [0.6]]), np.array([[0.45], [0.9]])
    given = points, tried, np.array(observed)
    other = 0.42 - nearest
    averaged = averaged_posterior(*given, [0.02, 0.4], 0.001)[0]
    near, far = (posterior(*given, scale, 0.001)[0] for scale in (nearest, other))
    assert np.abs(averaged - near).max() < np.abs(averaged - far).max()
