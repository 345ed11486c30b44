"""Both ends of archive/elites: the archive manager publishes changes, and subscribers mirror the elites."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pga_me_msgs.msg import Elites

from pga_me_ros.arrays import Float32Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.errors import RequestError
from pga_me_ros.ros.convert import finite, flat, shaped

NOBODY = -1
"""Evaluation id of a cell without a received elite."""


def elites_to_msg(archive: Archive, run_id: str, generation: int, cells: Int64Array) -> Elites:
    """Return the elites of some cells as a message.

    Args:
        archive: The archive as it is stored.
        run_id: Its run.
        generation: Its newest generation.
        cells: (n,) filled cells.
    """
    msg = Elites(run_id=run_id, generation=generation)
    msg.cells = flat(cells, "q")
    msg.evaluations = flat(archive.evaluations[cells], "q")
    msg.parameters = flat(archive.parameters[cells], "f")
    return msg


class EliteMirror:
    """The elites of an archive that were received.

    A cell's newest elite replaces the one before, so the mirror holds no more than the archive.

    Args:
        cells: Cells of the archive.
        parameter_count: Parameters P of a controller.
    """

    def __init__(self, cells: int, parameter_count: int) -> None:
        self._evaluations = np.full(cells, NOBODY, np.int64)
        self._parameters = np.empty((cells, parameter_count), np.float32)
        self._cell_of: dict[int, int] = {}

    def hear(self, msg: Elites) -> None:
        """Take the elites of a message.

        Raises:
            RequestError: The elites cannot belong to this archive, or a number is not finite; the mirror is then
                unchanged.
        """
        if msg.generation < 0:
            raise RequestError(f"Field 'generation' is {msg.generation}; expected 0 or more.")
        n, (cells, p) = len(msg.cells), self._parameters.shape
        where = _different("cells", shaped(msg.cells, (n,), np.int64, "cells"), cells)
        ids = _different("evaluations", shaped(msg.evaluations, (n,), np.int64, "evaluations"))
        parameters = shaped(msg.parameters, (n, p), np.float32, "parameters")
        self._parameters[where] = finite(parameters, "parameters")
        for left in self._evaluations[where].tolist():
            self._cell_of.pop(left, None)
        self._evaluations[where] = ids
        self._cell_of.update(zip(ids.tolist(), where.tolist(), strict=True))

    def lacking(self, evaluations: Int64Array) -> list[int]:
        """Return the evaluation ids whose elites were not received, ascending."""
        return [k for k in np.unique(evaluations).tolist() if k not in self._cell_of]

    def parameters(self, evaluations: Int64Array) -> Float32Array:
        """Return the parameters of elites by evaluation id; all must have been received.

        Args:
            evaluations: Ids, in any shape.

        Returns:
            (..., P) float32 array, a copy.
        """
        cells = [self._cell_of[k] for k in evaluations.ravel().tolist()]
        return self._parameters[cells].reshape(*evaluations.shape, self._parameters.shape[1])


def _different(name: str, values: NDArray[Any], end: int = 2**63) -> NDArray[Any]:
    """Return indices unless one is out of range or occurs twice."""
    if len(values) and not 0 <= values.min() <= values.max() < end:
        raise RequestError(
            f"Field '{name}' holds {values.min()} to {values.max()}; expected 0 to {end - 1}."
        )
    if len(np.unique(values)) < len(values):
        raise RequestError(f"Field '{name}' holds a number twice; expected each at most once.")
    return values
