"""The archives of MAP-Elites-ES (Colas et al. 2020): elites to start from, and all behaviors, for novelty."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.algorithms.map_elites_es.selection import (
    exploit_probabilities,
    explore_probabilities,
    plain_probabilities,
)
from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.cvt import CvtArchive
from pga_me_ros.core.archive.make_archive import make_archive
from pga_me_ros.core.archive.novelty import novelty
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import StorageError
from pga_me_ros.tasks.spec import TaskSpec

SCALED = "cells_in_shares_of_range"
"""Saved array that marks scaled distances; older states lack it, and find cells by distances in descriptor units."""

COLUMNS = ("fitness", "behaviors", "centers", "generations")
"""Columns of the elites, apart from the cell."""


class EsArchives:
    """The elites among the centers, and the behaviors of all centers, elites or not.

    The elites are those of the run's archive, which is offered nothing but centers.

    Args:
        spec: Task.
        settings: Settings of the run.
        parameter_count: Number P of parameters of a center.
    """

    def __init__(self, spec: TaskSpec, settings: Settings, parameter_count: int) -> None:
        self._spec = spec
        self._settings = settings
        self._behaviors = np.empty((0, spec.descriptor_dim))
        self._scaled = True
        self._cells = np.empty(0, np.int64)
        self._elites: dict[str, NDArray[Any]] = {
            "fitness": np.empty(0),
            "behaviors": np.empty((0, spec.descriptor_dim)),
            "centers": np.empty((0, parameter_count), np.float32),
            "generations": np.empty(0, np.int64),
        }

    def add(
        self, center: Float32Array, fitness: float, behavior: Float64Array, generation: int
    ) -> None:
        """Add an evaluated center; it replaces the elite of its cell if it is strictly fitter.

        Args:
            center: (P,) float32.
            fitness: Its fitness.
            behavior: (d,) float64 its descriptor.
            generation: Generation that evaluated it, later than those before.
        """
        self._behaviors = np.concatenate((self._behaviors, behavior[None]))
        cell = int(self._archive.cell_of(behavior[None])[0])
        row = int(np.searchsorted(self._cells, cell))
        values: tuple[Any, ...] = (fitness, behavior, center, generation)
        if row == len(self._cells) or self._cells[row] != cell:
            self._cells = np.insert(self._cells, row, cell)
            for name, value in zip(COLUMNS, values, strict=True):
                self._elites[name] = np.insert(self._elites[name], row, value, axis=0)
        elif fitness > self._elites["fitness"][row]:
            for name, value in zip(COLUMNS, values, strict=True):
                self._elites[name][row] = value

    def novelty(self, behaviors: Float64Array) -> Float64Array:
        """Return the novelty (n,) of behaviors (n, d) among those of all centers, of which there must be one."""
        neighbors = self._settings.es_neighbors
        return novelty(self._shares(behaviors), self._shares(self._behaviors), neighbors)

    def start(self, explore: bool, generation: int) -> Float32Array:
        """Draw the elite (P,) that the next steps start from, at the given generation."""
        fitness = self._elites["fitness"]
        if self._settings.es_cell_sampling == "plain":
            probabilities = plain_probabilities(fitness)
        elif explore:
            probabilities = explore_probabilities(self._elite_novelty())
        else:
            probabilities = exploit_probabilities(fitness, self._elites["generations"])
        rng = generator(self._settings.seed, Purpose.ES_SELECTION, generation)
        return self._elites["centers"][rng.choice(len(fitness), p=probabilities)].copy()

    def state(self) -> dict[str, NDArray[Any]]:
        """Return the whole state by name; the arrays are not changed afterwards."""
        elites = {f"elite_{name}": column.copy() for name, column in self._elites.items()}
        # Saved only where it matters, so that files of tasks in the unit box stay the same.
        told = {SCALED: np.ones(1, np.int64)} if self._scaled and not self._unit_box else {}
        return {"behaviors": self._behaviors, "elite_cells": self._cells, **told, **elites}

    def load_state(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Continue from what `state` returned, bit for bit.

        Raises:
            StorageError: Arrays are missing or do not fit the settings; nothing is changed then.
        """
        cells = checked(state, "elite_cells", np.int64, (None,))
        elites = {
            name: checked(state, f"elite_{name}", column.dtype, (len(cells), *column.shape[1:]))
            for name, column in self._elites.items()
        }
        behaviors = checked(state, "behaviors", np.float64, (None, self._behaviors.shape[1]))
        self._cells, self._behaviors = cells.copy(), behaviors.copy()
        self._elites = {name: column.copy() for name, column in elites.items()}
        self._scaled = self._unit_box or SCALED in state
        vars(self).pop("_archive", None)

    @cached_property
    def _archive(self) -> Archive:
        """Maps behaviors to cells; made on first use, since that takes seconds."""
        archive = make_archive(self._spec, self._settings)
        if self._scaled or not isinstance(archive, CvtArchive):
            return archive
        low, high = self._spec.descriptor_low, self._spec.descriptor_high
        return CvtArchive(archive.centroids, low, high, archive.parameter_count, scaled=False)

    @property
    def _unit_box(self) -> bool:
        return {*self._spec.descriptor_low} == {0.0} and {*self._spec.descriptor_high} == {1.0}

    def _elite_novelty(self) -> Float64Array:
        """Return the novelty of each elite among the behaviors of all other centers."""
        others = len(self._behaviors) - 1
        if not others:
            return np.zeros(1)
        near = min(self._settings.es_neighbors, others) + 1  # the nearest is its own, at distance 0
        elites, all_centers = self._shares(self._elites["behaviors"]), self._shares(self._behaviors)
        return novelty(elites, all_centers, near) * near / (near - 1)

    def _shares(self, behaviors: Float64Array) -> Float64Array:
        """Return (n, d) behaviors in shares of the descriptor's range; unchanged, bit for bit, in the unit box."""
        low, high = np.array(self._spec.descriptor_low), np.array(self._spec.descriptor_high)
        return (behaviors - low) / (high - low)


def checked(
    state: Mapping[str, NDArray[Any]], name: str, dtype: Any, shape: tuple[int | None, ...]
) -> NDArray[Any]:
    """Return an array of a stored state.

    Args:
        state: Arrays by name.
        name: Name of the array.
        dtype: Expected dtype.
        shape: Expected shape, None for any length.

    Raises:
        StorageError: The array is missing, or has another type or shape.
    """
    array = state.get(name)
    if array is None or array.dtype != dtype or not _fits(array.shape, shape):
        got = "is missing" if array is None else f"is {array.dtype} {array.shape}"
        raise StorageError(
            f"Saved array '{name}' of map_elites_es {got}, expected {np.dtype(dtype)} {shape}; resume with the task "
            "and settings that the run was started with."
        )
    return array


def _fits(found: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    return len(found) == len(expected) and all(
        e is None or f == e for f, e in zip(found, expected, strict=True)
    )
