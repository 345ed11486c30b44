"""The archive of state descriptors that QD-RL's diversity rewards are measured against (Cideron et al. 2020)."""

from __future__ import annotations

import numpy as np

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.archive.novelty import nearest_distance, novelty

BLOCK = 256
"""Descriptors that are added at a time."""


class StateArchive:
    """The newest state descriptors with a minimum distance between them.

    Args:
        dimensions: Number d of descriptor dimensions.
        capacity: Greatest number of descriptors; the oldest are dropped.
        spacing: A descriptor is added if it is farther than this from all in the archive; 0 adds all.

    Attributes:
        points: (m, d) float32, oldest first.
    """

    def __init__(self, dimensions: int, capacity: int, spacing: float) -> None:
        self.points: Float32Array = np.empty((0, dimensions), np.float32)
        self._capacity = capacity
        self._spacing = spacing

    def add(self, descriptors: Float32Array) -> None:
        """Offer descriptors one by one; after every `BLOCK` of them the oldest beyond the capacity are dropped.

        Args:
            descriptors: (n, d) float32.
        """
        if not self._spacing:
            self.points = np.concatenate([self.points, descriptors])[-self._capacity :]
            return
        for start in range(0, len(descriptors), BLOCK):
            block = descriptors[start : start + BLOCK]
            far = nearest_distance(_wide(block), _wide(self.points)) > self._spacing
            entered = _apart(block[far], self._spacing)
            if len(entered):
                self.points = np.concatenate([self.points, entered])[-self._capacity :]

    def novelty(self, descriptors: Float32Array, neighbors: int) -> Float64Array:
        """Return the mean distance (n,) of (n, d) descriptors to their nearest in the archive; 0 while it is empty."""
        return novelty(_wide(descriptors), _wide(self.points), neighbors)


def _apart(candidates: Float32Array, spacing: float) -> Float32Array:
    """Return the candidates that, in order, are farther than the spacing from those already accepted."""
    left, taken = candidates, []
    while len(left):
        taken.append(left[:1])
        left = left[1:][nearest_distance(_wide(left[1:]), _wide(left[:1])) > spacing]
    return np.concatenate(taken) if taken else candidates


def _wide(points: Float32Array) -> Float64Array:
    return points.astype(np.float64)
