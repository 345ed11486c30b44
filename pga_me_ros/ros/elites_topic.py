"""Both ends of archive/elites: the archive manager publishes changes, and subscribers mirror the elites."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pga_me_msgs.msg import Elites

from pga_me_ros.arrays import Float32Array, Float64Array, Int64Array
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.errors import RequestError
from pga_me_ros.ros.convert import finite, flat, shaped

NOBODY = -1
"""Evaluation id of a cell without a received elite."""


def elites_to_msg(
    archive: Archive, run_id: str, generation: int, cells: Int64Array, *, again: bool = False
) -> Elites:
    """Return the elites of some cells as a message.

    Args:
        archive: The archive as it is stored.
        run_id: Its run.
        generation: Its newest generation.
        cells: (n,) filled cells.
        again: Whether they were asked for, rather than all that the generation has changed.
    """
    msg = Elites(run_id=run_id, generation=generation, again=again)
    msg.cells = flat(cells, "q")
    msg.evaluations = flat(archive.evaluations[cells], "q")
    msg.descriptors = flat(archive.descriptors[cells], "d")
    msg.parameters = flat(archive.parameters[cells], "f")
    return msg


class EliteMirror:
    """The elites of an archive that were received.

    A cell's newest elite replaces the one before, so the mirror holds no more than the archive.

    Args:
        cells: Cells of the archive.
        parameter_count: Parameters P of a controller.
        descriptor_dim: Number d of descriptor dimensions.

    Attributes:
        generation: Latest generation whose changes were heard, -1 before the first.
    """

    def __init__(self, cells: int, parameter_count: int, descriptor_dim: int) -> None:
        self._evaluations = np.full(cells, NOBODY, np.int64)
        self._descriptors = np.empty((cells, descriptor_dim))
        self._parameters = np.empty((cells, parameter_count), np.float32)
        self._as_of = np.full(cells, -1, np.int64)  # generation of the message that each came in
        self._cell_of: dict[int, int] = {}
        self._since = 0  # first of the generations up to the latest whose changes were all heard
        self.generation = -1

    def hear(self, msg: Elites) -> None:
        """Take the elites of a message.

        Raises:
            RequestError: The elites cannot belong to this archive, or a number is not finite; the mirror is then
                unchanged.
        """
        if msg.generation < 0:
            raise RequestError(f"Field 'generation' is {msg.generation}; expected 0 or more.")
        n, (cells, p), d = len(msg.cells), self._parameters.shape, self._descriptors.shape[1]
        where = _different("cells", shaped(msg.cells, (n,), np.int64, "cells"), cells)
        ids = _different("evaluations", shaped(msg.evaluations, (n,), np.int64, "evaluations"))
        parameters = shaped(msg.parameters, (n, p), np.float32, "parameters")
        descriptors = shaped(msg.descriptors, (n, d), np.float64, "descriptors")
        finite(parameters, "parameters"), finite(descriptors, "descriptors")
        self._parameters[where], self._descriptors[where] = parameters, descriptors
        for left in self._evaluations[where].tolist():
            self._cell_of.pop(left, None)
        self._evaluations[where], self._as_of[where] = ids, msg.generation
        self._cell_of.update(zip(ids.tolist(), where.tolist(), strict=True))
        if not msg.again and msg.generation > self.generation:
            if msg.generation > self.generation + 1:  # changes were missed
                self._since = msg.generation
            self.generation = msg.generation

    def lacking(self, evaluations: Int64Array, generation: int = -1) -> list[int]:
        """Return the evaluation ids whose elites were not received, ascending.

        Args:
            evaluations: Ids, in any shape.
            generation: They are lacking, too, if they may have changed up to this generation without that having been
                heard: an elite that was evaluated again keeps its id, but has another descriptor.
        """
        wanted = np.unique(evaluations).tolist()
        return [k for k in wanted if k not in self._cell_of or not self._is_of(k, generation)]

    def _is_of(self, evaluation: int, generation: int) -> bool:
        """Whether a received elite is known as it was at a generation."""
        as_of = self._as_of[self._cell_of[evaluation]]
        followed = self.generation >= generation and as_of >= self._since - 1
        return bool(as_of >= generation or followed)

    def parameters(self, evaluations: Int64Array) -> Float32Array:
        """Return the parameters of elites by evaluation id; all must have been received.

        Args:
            evaluations: Ids, in any shape.

        Returns:
            (..., P) float32 array, a copy.
        """
        return self._parameters[self._cells(evaluations)]

    def descriptors(self, evaluations: Int64Array) -> Float64Array:
        """Return the achieved descriptors of elites by evaluation id, none of them lacking.

        Args:
            evaluations: Ids, in any shape.

        Returns:
            (..., d) float64 array, a copy.
        """
        return self._descriptors[self._cells(evaluations)]

    def _cells(self, evaluations: Int64Array) -> Int64Array:
        cells = [self._cell_of[k] for k in evaluations.ravel().tolist()]
        return np.array(cells, np.int64).reshape(evaluations.shape)


def _different(name: str, values: NDArray[Any], end: int = 2**63) -> NDArray[Any]:
    """Return indices unless one is out of range or occurs twice."""
    if len(values) and not 0 <= values.min() <= values.max() < end:
        raise RequestError(
            f"Field '{name}' holds {values.min()} to {values.max()}; expected 0 to {end - 1}."
        )
    if len(np.unique(values)) < len(values):
        raise RequestError(f"Field '{name}' holds a number twice; expected each at most once.")
    return values
