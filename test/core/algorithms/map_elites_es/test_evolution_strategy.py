"""Evolution strategies compared with analytic gradients, SciPy's ranks, torch's Adam and brute force."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from scipy.stats import rankdata
from torch.optim.adam import adam

from pga_me_ros.core.algorithms.map_elites_es.gradient import (
    Moments,
    adam_ascent,
    centered_ranks,
    gradient,
)
from pga_me_ros.core.archive.novelty import novelty
from pga_me_ros.core.variation.mirrored_samples import directions, mirrored

SIZE, SIGMA = 6, 0.02


def noise(pair: int) -> np.random.Generator:
    return np.random.default_rng([7, pair])


def quadratic(rng: np.random.Generator):
    """Return a quadratic function of (n, SIZE) points, and its gradient at one."""
    root, linear = rng.normal(size=(SIZE, SIZE)), rng.normal(size=SIZE)
    curvature = root @ root.T
    return (
        lambda x: x @ linear - 0.5 * np.einsum("ni,ij,nj->n", x, curvature, x),
        lambda x: linear - curvature @ x,
    )


def test_directions_that_span_the_space_give_the_gradient_of_a_quadratic_exactly():
    rng = np.random.default_rng(0)
    value, slope = quadratic(rng)
    point = rng.normal(size=SIZE)
    orthogonal = np.linalg.qr(rng.normal(size=(SIZE, SIZE)))[0] * np.sqrt(SIZE)
    samples = np.stack([point + s * SIGMA * e for e in orthogonal for s in (1, -1)])
    estimate = gradient(value(samples), iter(orthogonal), SIZE) / (2 * SIGMA)
    np.testing.assert_allclose(estimate, slope(point), rtol=1e-9)


def test_random_directions_give_the_gradient_of_a_quadratic_on_average():
    rng = np.random.default_rng(1)
    value, slope = quadratic(rng)
    point = rng.normal(size=SIZE).astype(np.float32)
    pairs = 4000
    samples = mirrored(point, 0.5, noise, 0, 2 * pairs).astype(np.float64)
    estimate = gradient(value(samples), directions(noise, pairs, SIZE), SIZE)
    expected = slope(point)
    # Entry i of one term has the variance |g|^2 + g_i^2 for Gaussian directions (Isserlis).
    deviation = np.sqrt((expected @ expected + expected**2) / pairs)
    assert (np.abs(estimate - expected) < 5 * deviation).all()
    assert (np.abs(estimate) > 10 * deviation).any()


def test_ranks_instead_of_values_still_point_uphill():
    rng = np.random.default_rng(2)
    value, slope = quadratic(rng)
    point = rng.normal(size=SIZE).astype(np.float32)
    samples = mirrored(point, SIGMA, noise, 0, 4000).astype(np.float64)
    estimate = gradient(
        centered_ranks(np.exp(3 * value(samples))), directions(noise, 2000, SIZE), SIZE
    )
    uphill = slope(point)
    assert estimate @ uphill > 0.99 * np.linalg.norm(estimate) * np.linalg.norm(uphill)


def test_every_sample_needs_its_direction():
    with pytest.raises(ValueError, match="argument 2"):
        gradient(np.zeros(6), iter(np.ones((2, SIZE))), SIZE)


@given(
    st.lists(st.sampled_from([-1e300, -2.0, -0.0, 0.0, 1e-9, 1.0, 3.5]), min_size=2, max_size=30)
)
def test_ranks_equal_scipys(values: list[float]):
    expected = (rankdata(values) - 1) / (len(values) - 1) - 0.5
    np.testing.assert_allclose(centered_ranks(values), expected, atol=1e-15)
    assert abs(centered_ranks(values).sum()) < 1e-12


def test_pairs_mirror_each_other_and_are_normal():
    center = np.linspace(-1, 1, 5000).astype(np.float32)
    samples = mirrored(center, SIGMA, noise, 0, 8).astype(np.float64)
    steps = (samples - center) / SIGMA
    np.testing.assert_allclose(steps[::2], -steps[1::2], atol=1e-4)
    np.testing.assert_allclose(steps[::2], np.stack(list(directions(noise, 4, 5000))), atol=1e-4)
    np.testing.assert_allclose(steps.std(), 1.0, atol=0.02)
    assert abs(np.corrcoef(steps[::2])[np.triu_indices(4, 1)]).max() < 0.06


@pytest.mark.parametrize("cuts", [(0, 10), (0, 1, 10), (0, 3, 4, 7, 10), range(11)], ids=str)
def test_any_division_gives_the_same_samples(cuts):
    center = np.ones(SIZE, np.float32)
    pieces = [mirrored(center, SIGMA, noise, a, b - a) for a, b in pairwise(cuts)]
    assert (np.concatenate(pieces) == mirrored(center, SIGMA, noise, 0, 10)).all()


def test_adam_equals_torchs():
    rng = np.random.default_rng(3)
    point, moments = rng.normal(size=20).astype(np.float32), Moments.none(20)
    theirs = torch.tensor(point, dtype=torch.float64)
    means, squares, steps = torch.zeros_like(theirs), torch.zeros_like(theirs), torch.zeros(())
    for _ in range(30):
        slope = rng.normal(size=20)
        point, moments = adam_ascent(point, slope, moments, 0.01)
        adam(
            *([theirs], [torch.tensor(slope)], [means], [squares], [], [steps]),
            **{"amsgrad": False, "maximize": True, "lr": 0.01, "weight_decay": 0.0},
            **{"beta1": 0.9, "beta2": 0.999, "eps": 1e-8},
        )
        np.testing.assert_allclose(point, theirs.numpy(), atol=3e-6)
    assert moments.steps == 30
    assert point.dtype == np.float32


@pytest.mark.parametrize(("others", "k"), [(1, 10), (7, 10), (40, 10), (40, 1)])
def test_novelty_equals_brute_force(others: int, k: int):
    rng = np.random.default_rng(4)
    behaviors, found = rng.random((25, 3)), rng.random((others, 3))
    distances = np.sort(cdist(behaviors, found), axis=1)[:, :k]
    np.testing.assert_allclose(novelty(behaviors, found, k), distances.mean(axis=1), rtol=1e-12)
