"""The archive of MAP-Elites: one elite per cell (Alg. 3, Nilsson & Cully 2021)."""

from __future__ import annotations

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from pga_me_ros.arrays import BoolArray, Float64Array, Int64Array
from pga_me_ros.core.archive.elite_table import EliteTable
from pga_me_ros.core.archive.elites import Solutions, Status
from pga_me_ros.core.archive.geometry import checked_box
from pga_me_ros.core.operators import Operator
from pga_me_ros.errors import ArchiveError


@dataclass(frozen=True)
class AddResult:
    """The outcome for each solution of a batch.

    Attributes:
        status: (n,) int64 values of `Status`, in the order of the batch.
        cells: (n,) int64 cells that the solutions fell into.
    """

    status: Int64Array
    cells: Int64Array

    @property
    def changed_cells(self) -> Int64Array:
        """Cells that got a new elite, without duplicates, ascending."""
        return np.unique(self.cells[self.status != Status.REJECTED])


class Archive(EliteTable, ABC):
    """One elite per cell; subclasses decide which descriptor belongs to which cell.

    Args:
        centroids: (cells, d) float64 centers of the cells.
        low: Lower bound of each of the d descriptor dimensions.
        high: Upper bounds.
        parameter_count: Number P of parameters of a controller.

    Raises:
        ArchiveError: Centroids, bounds or the parameter count do not fit together.
    """

    kind: ClassVar[str]

    def __init__(
        self,
        centroids: ArrayLike,
        low: Sequence[float],
        high: Sequence[float],
        parameter_count: int,
    ) -> None:
        """Make an empty archive."""
        self.low, self.high = checked_box(low, high)
        self.centroids: Float64Array = np.array(centroids, np.float64)
        shape, dimensions = self.centroids.shape, len(self.low)
        if len(shape) != 2 or shape[1] != dimensions:
            raise ArchiveError(f"Centroids have the shape {shape}; expected (cells, {dimensions}).")
        if not np.isfinite(self.centroids).all():
            raise ArchiveError("Centroids must be finite; NaN or infinity was among them.")
        super().__init__(shape[0], dimensions, parameter_count, self.high - self.low)

    @abstractmethod
    def _nearest_cells(self, descriptors: Float64Array) -> Int64Array:
        """Return the cells of (n, d) finite descriptors."""

    @property
    def bins(self) -> tuple[int, ...]:
        """Bins per descriptor dimension of a grid, empty for other archives."""
        return ()

    @property
    def note(self) -> str:
        """What users of a stored archive should know about its cells; empty if there is nothing to say."""
        return ""

    def coordinates(self, descriptors: Float64Array) -> Float64Array:
        """Return (n, d) descriptors in the coordinates that decide on the cell: shares of the range."""
        return (descriptors - self.low) / self.extent

    def cell_of(self, descriptors: ArrayLike) -> Int64Array:
        """Return the cell of each descriptor.

        Args:
            descriptors: (n, d) numbers.

        Returns:
            (n,) int64 array.

        Raises:
            ArchiveError: The shape is wrong or a number is not finite.
        """
        return self._nearest_cells(self.checked_descriptors(descriptors))

    def add(self, batch: Solutions, offered: BoolArray | None = None) -> AddResult:
        """Add solutions one after the other; a strictly fitter one replaces an elite (Alg. 3 lines 17-23).

        If anything about the batch is wrong, none of it is added.

        Args:
            batch: The solutions.
            offered: (n,) which of them may enter, all by default; the others are rejected whatever their fitness.

        Raises:
            ArchiveError: Fitness, descriptors or parameters are not finite or of the wrong shape.
        """
        self.check(batch)
        cells = self.cell_of(batch.descriptors)
        status = np.full(len(batch), Status.REJECTED, np.int64)
        for i, cell in enumerate(cells.tolist()):
            if offered is not None and not offered[i]:
                continue
            if not self.filled[cell]:
                status[i] = Status.NEW
            elif batch.fitness[i] > self.fitness[cell]:
                status[i] = Status.IMPROVED
            else:
                continue
            self.put(batch.elite(i, cell))
        return AddResult(status, cells)

    def digest(self) -> str:
        """Return the SHA-256 of cells and elites as hexadecimal digits.

        Equal digests mean equal repertoires, bit for bit. Times, names and paths do not enter it.
        """
        out = hashlib.sha256(f"{self.kind} {self.bins} {self.parameters.shape}".encode())
        for array in (self.low, self.high, self.centroids):
            out.update(array.astype("<f8").tobytes())
        for elite in self.elites():
            out.update(elite.to_bytes())
        return out.hexdigest()

    def check(self, batch: Solutions) -> None:
        """Make sure that all of a batch fits, but for its descriptors, which `cell_of` checks.

        Raises:
            ArchiveError: Fitness or parameters are not finite or of the wrong shape, or an operator is unknown.
        """
        batch.check_shapes()
        if batch.parameters.shape[1] != self.parameter_count:
            raise ArchiveError(
                f"Solutions have {batch.parameters.shape[1]} parameters; this archive's "
                f"controllers have {self.parameter_count}."
            )
        if not set(batch.operators.tolist()) <= set(Operator):
            raise ArchiveError(f"operators must be of {[int(o) for o in Operator]}.")
        for name, values in (("fitness", batch.fitness[:, None]), ("parameters", batch.parameters)):
            finite = np.isfinite(values).all(axis=1)
            if not finite.all():
                evaluation = int(batch.evaluations[finite.argmin()])
                raise ArchiveError(
                    f"The {name} of evaluation {evaluation} must be finite, not NaN or infinite."
                )
