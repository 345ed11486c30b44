"""Archives of equal bins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pga_me_ros.arrays import Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.geometry import checked_box
from pga_me_ros.errors import ArchiveError

ON_EDGE = 1e-6
"""Share of a bin below its lower edge that still counts as on the edge: far above rounding errors, far below any
difference that matters. It equals pyribs' default in a range of 1."""


class GridArchive(Archive):
    """Equal bins per dimension, the last dimension varying fastest.

    A bin includes its lower edge, the last bin also its upper edge. Descriptors outside the bounds
    belong to the outermost bin. A descriptor less than `ON_EDGE` of a bin below an edge counts as
    on the edge: in -1 to 1 with 20 bins, 0.3 is on the edge of bin 13, but 20 * (0.3 + 1) / 2 need not be 13.

    Args:
        bins: Bins of each of the d descriptor dimensions.
        low: Lower bound of each dimension.
        high: Upper bounds.
        parameter_count: Number P of parameters of a controller.

    Raises:
        ArchiveError: Bins, bounds or the parameter count do not fit together.
    """

    kind = "grid"

    def __init__(
        self, bins: Sequence[int], low: Sequence[float], high: Sequence[float], parameter_count: int
    ) -> None:
        """Make an empty archive."""
        self._bins = tuple(int(n) for n in bins)
        super().__init__(grid_centroids(self._bins, low, high), low, high, parameter_count)

    @property
    def bins(self) -> tuple[int, ...]:
        """Bins per descriptor dimension."""
        return self._bins

    def _nearest_cells(self, descriptors: Float64Array) -> Int64Array:
        bins = np.array(self._bins)
        inside = np.clip(descriptors, self.low, self.high)
        position = bins * ((inside - self.low) / (self.high - self.low))
        coordinates = np.minimum((position + ON_EDGE).astype(np.int64), bins - 1)
        return np.ravel_multi_index(tuple(coordinates.T), self._bins).astype(np.int64)


def grid_centroids(
    bins: Sequence[int], low: Sequence[float], high: Sequence[float]
) -> Float64Array:
    """Return the centers of equal bins, the last dimension varying fastest.

    Args:
        bins: Number of bins of each of the d descriptor dimensions.
        low: Lower bound of each dimension.
        high: Upper bounds.

    Returns:
        (prod(bins), d) float64 array.

    Raises:
        ArchiveError: The box is empty or not finite, or the bins do not fit it.
    """
    lower, upper = checked_box(low, high)
    if len(bins) != len(lower) or min(bins) < 1:
        raise ArchiveError(
            f"bins are {list(bins)}; expected {len(lower)} numbers of at least 1, one a dimension."
        )
    axes = [
        a + (b - a) * (np.arange(n) + 0.5) / n for n, a, b in zip(bins, lower, upper, strict=True)
    ]
    return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
