"""The archive of state descriptors compared with a plain loop."""

from __future__ import annotations

import numpy as np
import pytest

from pga_me_ros.core.algorithms.qd_rl.state_archive import BLOCK, StateArchive
from pga_me_ros.core.archive.novelty import novelty


def descriptors(n: int, d: int = 2, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((n, d), np.float32)


def by_a_loop(
    start: list[np.ndarray], offered: np.ndarray, capacity: int, spacing: float
) -> list[np.ndarray]:
    kept = list(start)
    for i, descriptor in enumerate(offered, 1):
        if all(np.linalg.norm((descriptor - k).astype(float)) > spacing for k in kept):
            kept.append(descriptor)
        if i % BLOCK == 0 or i == len(offered):
            kept = kept[-capacity:]
    return kept


@pytest.mark.parametrize("capacity", [1, 20, 1000])
@pytest.mark.parametrize("spacing", [0.02, 0.1])
@pytest.mark.parametrize("d", [1, 2, 4])
def test_descriptors_enter_and_leave_as_in_a_plain_loop(capacity, spacing, d):
    archive, kept = StateArchive(d, capacity, spacing), []
    for seed, n in enumerate((700, 1, 30, BLOCK)):
        offered = descriptors(n, d, seed)
        archive.add(offered)
        kept = by_a_loop(kept, offered, capacity, spacing)
        np.testing.assert_array_equal(archive.points, np.array(kept, np.float32))


def test_without_spacing_the_newest_are_kept():
    archive = StateArchive(2, 50, 0.0)
    for seed in range(3):
        archive.add(descriptors(40, seed=seed))
    every = np.concatenate([descriptors(40, seed=seed) for seed in range(3)])
    np.testing.assert_array_equal(archive.points, every[-50:])


def test_equal_descriptors_enter_once():
    archive = StateArchive(2, 50, 0.1)
    archive.add(np.zeros((300, 2), np.float32))
    assert archive.points.tolist() == [[0.0, 0.0]]


def test_novelty_is_relative_to_the_stored_points():
    archive = StateArchive(2, 100, 0.05)
    archive.add(descriptors(500))
    asked = descriptors(20, seed=1)
    expected = novelty(asked.astype(float), archive.points.astype(float), 5)
    np.testing.assert_array_equal(archive.novelty(asked, 5), expected)


def test_nothing_is_novel_in_an_empty_archive():
    assert StateArchive(2, 100, 0.05).novelty(descriptors(3), 5).tolist() == [0.0, 0.0, 0.0]
