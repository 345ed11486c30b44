"""A ring of rows: the newest so many, first in first out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.float32]
Indices = NDArray[np.int64]


class Ring:
    """The newest rows, oldest first by index.

    Memory is reserved at once but taken from the machine only as rows are written.

    Args:
        capacity: Rows kept; older ones are overwritten.
        width: Numbers per row.

    Raises:
        MemoryError: The machine cannot reserve that much memory.
    """

    def __init__(self, capacity: int, width: int) -> None:
        self._rows = np.empty((capacity, width), np.float32)
        self._size = 0
        self._oldest = 0

    def __len__(self) -> int:
        """Return the number of rows held."""
        return self._size

    def append(self, rows: Rows) -> None:
        """Add (n, width) float32 rows in their order."""
        capacity = len(self._rows)
        rows = rows[-capacity:]
        start = (self._oldest + self._size) % capacity
        before_wrap = min(len(rows), capacity - start)
        self._rows[start : start + before_wrap] = rows[:before_wrap]
        self._rows[: len(rows) - before_wrap] = rows[before_wrap:]
        overwritten = max(0, self._size + len(rows) - capacity)
        self._oldest = (self._oldest + overwritten) % capacity
        self._size += len(rows) - overwritten

    def take(self, indices: Indices, out: Rows | None = None) -> Rows:
        """Return some rows.

        Args:
            indices: (n,) int64, 0 the oldest row held; below `len`.
            out: (n, width) float32 to write to.

        Returns:
            (n, width) float32, a copy.
        """
        # Indices count from the oldest row, wherever it lies in the ring: one that was saved and read
        # back gives the same rows although it starts elsewhere.
        return np.take(self._rows, indices + self._oldest, axis=0, out=out, mode="wrap")
