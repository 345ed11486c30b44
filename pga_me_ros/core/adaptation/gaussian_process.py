"""Gaussian process regression with a Matern 5/2 kernel, of variance 1 as in Intelligent Trial and Error or of another.

Cully, Clune, Tarapore & Mouret, *Robots that can adapt like animals* (Nature 2015, arXiv 1407.3501), supplementary
methods: the process models by how much achieved performance differs from the repertoire's, so its own mean is 0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pga_me_ros.arrays import Float64Array


def matern52(first: Float64Array, second: Float64Array, length_scale: float) -> Float64Array:
    """Return the kernel of each pair of points: (1 + r + r²/3) exp(-r), where r is sqrt(5) distance / length scale.

    Args:
        first: (n, d) float64 points.
        second: (m, d) float64 points.
        length_scale: Distance over which behaviors tell about each other.

    Returns:
        (n, m) float64, 1 for a point and itself.
    """
    squares = ((first[:, None, :] - second[None, :, :]) ** 2).sum(axis=2)
    r = np.sqrt(5.0 * squares) / length_scale
    return (1.0 + r + r * r / 3.0) * np.exp(-r)


def posterior(
    points: Float64Array,
    tried: Float64Array,
    differences: Float64Array,
    length_scale: float,
    noise: float,
    variance: float = 1.0,
) -> tuple[Float64Array, Float64Array]:
    """Return mean and standard deviation of a process at some points, given what was observed at others.

    Args:
        points: (n, d) float64.
        tried: (t, d) float64 points of the observations; t may be 0, and points may repeat.
        differences: (t,) float64 observations.
        length_scale: As in `matern52`.
        noise: Variance of an observation's noise, above 0.
        variance: Variance of the process.

    Returns:
        (n,) float64 means and (n,) float64 standard deviations, the noise left out.
    """
    if not len(tried):
        return np.zeros(len(points)), np.full(len(points), np.sqrt(variance))
    lower = _factor(tried, length_scale, noise, variance)
    between = variance * matern52(tried, points, length_scale)
    whitened = np.linalg.solve(lower, between)
    means = whitened.T @ np.linalg.solve(lower, differences)
    # Rounding may leave a variance a little below 0 where the same point was observed again and again.
    variances = np.maximum(variance - (whitened**2).sum(axis=0), 0.0)
    return means, np.sqrt(variances)


def averaged_posterior(
    points: Float64Array,
    tried: Float64Array,
    differences: Float64Array,
    length_scales: Sequence[float],
    noise: float,
) -> tuple[Float64Array, Float64Array]:
    """Return the posterior without knowing the length scale: all given ones count by how well they explain the trials.

    A mixture of the processes, weighted by their marginal likelihoods; each length scale is as likely as any other
    before the first observation.

    Args:
        points: As in `posterior`.
        tried: As in `posterior`.
        differences: As in `posterior`.
        length_scales: One or more.
        noise: As in `posterior`.

    Returns:
        (n,) float64 means and (n,) float64 standard deviations of the mixture.
    """
    logs = [log_likelihood(tried, differences, scale, noise) for scale in length_scales]
    parts = [posterior(points, tried, differences, scale, noise) for scale in length_scales]
    return mixture(parts, logs)


def mixture(
    parts: Sequence[tuple[Float64Array, Float64Array]], logs: Sequence[float]
) -> tuple[Float64Array, Float64Array]:
    """Return mean and standard deviation of a mixture.

    Args:
        parts: (n,) float64 means and (n,) float64 standard deviations of each part.
        logs: Logarithm of each part's weight, up to a constant.
    """
    weights = np.exp(np.array(logs) - max(logs))
    weights /= weights.sum()
    means, deviations = (np.stack(values) for values in zip(*parts, strict=True))
    mean = weights @ means
    variance = weights @ (deviations**2 + (means - mean) ** 2)
    return mean, np.sqrt(variance)


def log_likelihood(
    tried: Float64Array,
    differences: Float64Array,
    length_scale: float,
    noise: float,
    variance: float = 1.0,
) -> float:
    """Return the logarithm of the density that a process gives to what was observed.

    Args:
        tried: As in `posterior`.
        differences: As in `posterior`.
        length_scale: As in `matern52`.
        noise: As in `posterior`.
        variance: As in `posterior`.
    """
    lower = _factor(tried, length_scale, noise, variance)
    whitened = np.linalg.solve(lower, differences)
    constant = len(tried) * np.log(2.0 * np.pi)
    return float(-0.5 * (whitened @ whitened + constant) - np.log(np.diag(lower)).sum())


def _factor(
    tried: Float64Array, length_scale: float, noise: float, variance: float
) -> Float64Array:
    """Return the Cholesky factor of the observations' covariance."""
    covariance = variance * matern52(tried, tried, length_scale) + noise * np.eye(len(tried))
    return np.asarray(np.linalg.cholesky(covariance), np.float64)
