"""Cells that hold several solutions, judged by the means of all their evaluations: Extract-MAP-Elites.

Flageat, Huber, Helenon, Doncieux, Cully, *Extract-QD Framework* (GECCO 2025, arXiv 2502.06585): in each generation some
solutions are taken out of the archive, evaluated once more, and offered to it again with the means of all their
evaluations. A cell keeps the next best ones below its elite, so that one of them returns when the elite was lucky. As
in the authors' program, solution k of a cell is taken with a probability proportional to exp(-k); the elite has k = 0.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pga_me_ros.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from pga_me_ros.core.archive.archive import AddResult, Archive
from pga_me_ros.core.archive.elites import Elite, Solutions, Status
from pga_me_ros.core.operators import Operator
from pga_me_ros.core.rng import Purpose, generator
from pga_me_ros.errors import RequestError


@dataclass(frozen=True)
class Samples:
    """All evaluations of a solution.

    Attributes:
        count: How many.
        fitness: Sum of their fitness.
        descriptor: (d,) float64 sum of their descriptors.
    """

    count: int
    fitness: float
    descriptor: Float64Array

    def with_one(self, fitness: float, descriptor: Float64Array) -> Samples:
        """Return these and one more."""
        return Samples(self.count + 1, self.fitness + fitness, self.descriptor + descriptor)

    def estimate(self, solution: Elite) -> Elite:
        """Return a solution with the means as its fitness and descriptor."""
        return dataclasses.replace(
            solution,
            fitness=self.fitness / self.count,
            descriptor=self.descriptor / self.count,
        )


@dataclass(frozen=True)
class DepthChange:
    """What a generation changed.

    Attributes:
        added: What became of each solution of the batch. One that was taken out is never new: it was found before.
        changed_cells: (n,) int64 cells whose elite is another one than before, or has another estimate, ascending.
        emptied_cells: (n,) int64 cells that hold no solution any more, ascending.
        below: Solutions below the elites that are new there or have another estimate.
        samples: Evaluations of solutions that had some in this generation, by evaluation id.
        left: Evaluation ids of solutions that are below an elite no more, ascending.
        forgotten: Evaluation ids of solutions that the archive does not hold any more, ascending.
    """

    added: AddResult
    changed_cells: Int64Array
    emptied_cells: Int64Array
    below: tuple[Elite, ...]
    samples: dict[int, Samples]
    left: tuple[int, ...]
    forgotten: tuple[int, ...]


class CellDepth:
    """The solutions below the elites of an archive, and the evaluations of all that it holds.

    In a cell the fittest comes first; of equals, the one with the lower evaluation id.

    Args:
        archive: The archive; its elites are the first solutions of their cells.
        depth: Most solutions of a cell, the elite included.

    Attributes:
        below: Solutions below the elite of each cell that has some.
        samples: All evaluations of each solution that the archive holds, by evaluation id.
    """

    def __init__(self, archive: Archive, depth: int) -> None:
        self.archive = archive
        self.below: dict[int, list[Elite]] = {}
        self.samples: dict[int, Samples] = {}
        self._depth = depth

    def restore(self, below: Iterable[Elite], samples: dict[int, Samples]) -> None:
        """Take solutions and evaluations as they were stored."""
        for solution in below:
            self.below.setdefault(solution.cell, []).append(solution)
        for solutions in self.below.values():
            solutions.sort(key=_rank)
        self.samples = dict(samples)

    @property
    def everything(self) -> DepthChange:
        """All of it as the change that makes an archive of elites what it is."""
        none = np.empty(0, np.int64)
        return DepthChange(
            added=AddResult(none, none),
            changed_cells=self.archive.filled_cells(),
            emptied_cells=none,
            below=tuple(s for solutions in self.below.values() for s in solutions),
            samples=self.samples,
            left=(),
            forgotten=(),
        )

    def draw(self, seed: int, generation: int, count: int) -> Int64Array:
        """Draw which solutions a generation takes out.

        Where the archive holds fewer than are to be drawn, all of them are taken, again and again.

        Args:
            seed: Seed of the run.
            generation: The generation; all before it have been added.
            count: How many.

        Returns:
            (count,) int64 evaluation ids.

        Raises:
            RequestError: The archive is empty.
        """
        ids: list[int] = []
        ranks: list[int] = []
        for cell in self.archive.filled_cells().tolist():
            ids.append(int(self.archive.evaluations[cell]))
            ids += [solution.evaluation for solution in self.below.get(cell, ())]
            ranks += range(len(ids) - len(ranks))
        if not ids:
            raise RequestError("The archive is empty; nothing can be taken out of it.")
        weights = np.exp(-np.array(ranks, np.float64))
        rng = generator(seed, Purpose.EXTRACTION, generation)
        drawn = rng.choice(len(ids), min(count, len(ids)), replace=False, p=weights / weights.sum())
        return np.resize(np.array(ids, np.int64)[drawn], count)

    def parameters(self, ids: Int64Array) -> Float32Array:
        """Return the controllers of solutions.

        Args:
            ids: (n,) evaluation ids of solutions that the archive holds.

        Returns:
            (n, P) float32.
        """
        found = {
            int(self.archive.evaluations[cell]): self.archive.parameters[cell]
            for cell in self.archive.filled_cells().tolist()
        }
        for solutions in self.below.values():
            found |= {solution.evaluation: solution.parameters for solution in solutions}
        return np.stack([found[k] for k in ids.tolist()])

    def add(self, batch: Solutions, offered: BoolArray) -> DepthChange:
        """Add a generation: first what was taken out, with the means of all its evaluations, then what is new.

        Args:
            batch: The solutions of the generation; those taken out have the operator `EXTRACTED` and, as their first
                parent, the evaluation id by which the archive knows them.
            offered: (n,) which of the others are offered.

        Raises:
            ArchiveError: Fitness, descriptors or parameters are not finite or of the wrong shape.
            RequestError: A solution that was taken out is not in the archive.
        """
        self.archive.check(batch)
        cells = self.archive.cell_of(batch.descriptors)
        again = batch.operators == Operator.EXTRACTED
        samples = self._evaluated_again(batch, np.flatnonzero(again))
        taken = self._held(list(samples))
        renewed = self._renewed(taken, samples)
        new = np.flatnonzero(~again & offered).tolist()
        affected = {s.cell for s in (*taken, *renewed)} | {int(cells[i]) for i in new}
        before = {cell: self._solutions(cell) for cell in sorted(affected)}
        after = {
            cell: [s for s in solutions if s.evaluation not in samples]
            for cell, solutions in before.items()
        }
        for solution in renewed:
            self._insert(after[solution.cell], solution)
        status = np.full(len(batch), Status.REJECTED, np.int64)
        for i in new:
            solution = _sound(batch.elite(i, int(cells[i])))
            samples[solution.evaluation] = Samples(1, solution.fitness, solution.descriptor)
            there = after[solution.cell]
            first = not there
            self._insert(there, solution)
            if there[0] is solution:
                status[i] = Status.NEW if first else Status.IMPROVED
        return self._take_over(before, after, samples, AddResult(status, cells))

    def _evaluated_again(self, batch: Solutions, places: Int64Array) -> dict[int, Samples]:
        """Return the evaluations of the solutions that were taken out, the new ones included, by evaluation id.

        Raises:
            RequestError: One is not in the archive.
        """
        found: dict[int, Samples] = {}
        for i in places.tolist():
            known = int(batch.parents[i, 0])
            if known not in self.samples:
                raise RequestError(
                    f"Evaluation {batch.evaluations[i]} is said to be that of solution {known} once more, which the "
                    "archive does not hold."
                )
            so_far = found.get(known, self.samples[known])
            found[known] = so_far.with_one(float(batch.fitness[i]), batch.descriptors[i])
        return found

    def _held(self, ids: list[int]) -> list[Elite]:
        """Return solutions that the archive holds, in the order of their evaluation ids `ids`."""
        found = {}
        for cell in np.flatnonzero(
            self.archive.filled & np.isin(self.archive.evaluations, ids)
        ).tolist():
            elite = self.archive.elite(cell)
            found[elite.evaluation] = elite
        for solutions in self.below.values():
            found |= {s.evaluation: s for s in solutions}
        return [found[k] for k in ids]

    def _renewed(self, taken: list[Elite], samples: dict[int, Samples]) -> list[Elite]:
        """Return solutions that were taken out with their new estimates, in the cells of these."""
        if not taken:
            return []
        estimates = [_sound(samples[s.evaluation].estimate(s)) for s in taken]
        cells = self.archive.cell_of(np.stack([s.descriptor for s in estimates]))
        return [dataclasses.replace(s, cell=int(c)) for s, c in zip(estimates, cells, strict=True)]

    def _solutions(self, cell: int) -> list[Elite]:
        """Return all solutions of a cell, the elite first."""
        if not self.archive.filled[cell]:
            return []
        return [self.archive.elite(cell), *self.below.get(cell, ())]

    def _insert(self, solutions: list[Elite], solution: Elite) -> None:
        """Put a solution into its place among those of its cell, and drop what goes beyond the depth."""
        solutions.append(solution)
        solutions.sort(key=_rank)
        del solutions[self._depth :]

    def _take_over(
        self,
        before: dict[int, list[Elite]],
        after: dict[int, list[Elite]],
        samples: dict[int, Samples],
        added: AddResult,
    ) -> DepthChange:
        """Make the archive hold what cells hold afterwards; returns what has changed."""
        changed, emptied = [], []
        for cell, solutions in after.items():
            if solutions and (not before[cell] or _key(solutions[0]) != _key(before[cell][0])):
                self.archive.put(solutions[0])
                changed.append(cell)
            elif before[cell] and not solutions:
                self.archive.clear(cell)
                emptied.append(cell)
            self.below.pop(cell, None)
            if solutions[1:]:
                self.below[cell] = solutions[1:]
        was = {_key(s) for solutions in before.values() for s in solutions[1:]}
        now = [s for solutions in after.values() for s in solutions[1:]]
        held = {s.evaluation for solutions in after.values() for s in solutions}
        forgotten = {s.evaluation for solutions in before.values() for s in solutions} - held
        kept = {k: samples[k] for k in sorted(samples.keys() & held)}
        self.samples |= kept
        for k in forgotten:
            del self.samples[k]
        return DepthChange(
            added=added,
            changed_cells=np.array(changed, np.int64),
            emptied_cells=np.array(emptied, np.int64),
            below=tuple(s for s in now if _key(s) not in was),
            samples=kept,
            left=tuple(sorted({k for k, *_ in was} - {s.evaluation for s in now})),
            forgotten=tuple(sorted(forgotten)),
        )


def _rank(solution: Elite) -> tuple[float, int]:
    return -solution.fitness, solution.evaluation


def _key(solution: Elite) -> tuple[int, int, float, bytes]:
    """Return what differs when a solution is another one, is elsewhere, or has another estimate."""
    return (
        solution.evaluation,
        solution.cell,
        solution.fitness,
        solution.descriptor.tobytes(),
    )


def _sound(solution: Elite) -> Elite:
    """Return a solution with arrays of its own and without negative zeros, which SQLite does not keep apart."""
    return dataclasses.replace(
        solution,
        fitness=solution.fitness + 0.0,
        descriptor=solution.descriptor + 0.0,
        parameters=solution.parameters.copy(),
    )
