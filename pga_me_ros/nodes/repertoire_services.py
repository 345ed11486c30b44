"""What other robot nodes may ask about a repertoire: get_behavior, get_behaviors, list_behaviors, get_info."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from pga_me_msgs.msg import Metrics as MetricsMsg
from pga_me_msgs.srv import GetBehavior, GetBehaviors, GetInfo, ListBehaviors

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.elite_table import EliteTable
from pga_me_ros.core.errors import PgaError, RequestError, StorageError
from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.reevaluations import Statistics
from pga_me_ros.core.run_info import RunInfo
from pga_me_ros.nodes.known_statistics import KnownStatistics
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import behavior_to_msg, controller_to_msg, flat
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.tasks.spec import TaskSpec

PAGE = 10_000
"""Most elites in one answer of list_behaviors."""

MOST = 1000
"""Most elites in one answer of get_behaviors, which may hold their controllers."""


class NotFoundError(PgaError):
    """No elite fits the request, though it was understood."""


class RepertoireServices:
    """The services that only read.

    Args:
        node: Node that offers them.
        info: Description of the run in the repertoire file.
        archive: The archive; replace the attribute when it is another object.
        growing: Whether a run adds to it.
        path: The repertoire file.

    Attributes:
        metrics: Newest metrics, for get_info; to be replaced when the archive has changed.
    """

    def __init__(
        self, node: GraphNode, info: RunInfo, archive: Archive, growing: bool, path: Path
    ) -> None:
        self.archive = archive
        self._node = node
        self._info = info
        self._growing = growing
        self._known = KnownStatistics(path, info.run_id)
        self._spec = TaskSpec.from_json(info.task)
        self._shape = MlpShape(tuple(info.layer_sizes))
        self.metrics = MetricsMsg()
        # What a robot tries next is no part of the run, so it need not be repeatable.
        self._any = np.random.default_rng()
        many = qos.ASKED_BY_MANY
        node.serve(GetBehavior, names.GET_BEHAVIOR, self._get_behavior, "found", many)
        node.serve(GetBehaviors, names.GET_BEHAVIORS, self._get_behaviors, "ok", many)
        node.serve(ListBehaviors, names.LIST_BEHAVIORS, self._list, "ok", many)
        node.create_service(GetInfo, names.GET_INFO, self._get_info, qos_profile=many)

    def _get_behavior(self, request: GetBehavior.Request, response: GetBehavior.Response) -> None:
        try:
            cell, distance = self._choose(request)
        except NotFoundError as reason:  # an answer as good as any, no fault of the asker's
            response.found, response.message = False, str(reason)
            return
        elite = self.archive.elite(cell)
        response.behavior = behavior_to_msg(elite, self._statistics())
        response.distance = distance
        response.controller = controller_to_msg(elite.parameters, self._shape, self._spec)
        self._node.count_done()

    def _get_behaviors(
        self, request: GetBehaviors.Request, response: GetBehaviors.Response
    ) -> None:
        if not 1 <= request.count <= MOST:
            raise RequestError(f"count is {request.count}; expected 1 to {MOST}.")
        try:
            cells, distances = self._nearest(request, _least_fitness(request), request.count)
        except NotFoundError as reason:
            response.message = str(reason)
            return
        known = self._statistics()
        elites = [self.archive.elite(cell) for cell in cells.tolist()]
        response.behaviors = [behavior_to_msg(elite, known) for elite in elites]
        response.distances = flat(distances, "d")
        if request.with_controllers:
            response.controller = controller_to_msg(np.empty(0), self._shape, self._spec)
            response.parameters = flat(self.archive.parameters[cells], "f")
        self._node.count_done()

    def _choose(self, request: GetBehavior.Request) -> tuple[int, float]:
        """Return the cell that a request selects, and its elite's distance to the wanted descriptor.

        Raises:
            RequestError: The request makes no sense.
            ArchiveError: Its descriptor or cell does not fit the archive.
            NotFoundError: No elite fits.
        """
        least = _least_fitness(request)
        if request.select == GetBehavior.Request.DESCRIPTOR:
            cells, distances = self._nearest(request, least, 1)
            return int(cells[0]), float(distances[0])
        _check_distance(request)
        seen = self._seen(request.by_mean)
        if request.select == GetBehavior.Request.CELL:
            return self._of_cell(seen, request.cell, least), 0.0
        if request.select == GetBehavior.Request.BEST:
            cells = _at_least(seen, least)
            return int(cells[seen.fitness[cells].argmax()]), 0.0
        if request.select == GetBehavior.Request.RANDOM:
            return int(self._any.choice(_at_least(seen, least))), 0.0
        raise RequestError(
            f"select is {request.select}; expected 0 (descriptor), 1 (cell), 2 (best) or 3 (random)."
        )

    def _seen(self, by_mean: bool) -> EliteTable:
        """Return the elites as a request wants them judged.

        Raises:
            RequestError: By their means, but the file of re-evaluations cannot be used.
            NotFoundError: By their means, but none was re-evaluated.
        """
        if not by_mean:
            return self.archive
        try:
            seen = self._known.of(self.archive, self.metrics.generation).seen(self.archive)
        except StorageError as error:
            raise RequestError(f"by_mean cannot be answered: {error}") from None
        if len(self.archive) and not len(seen):
            raise NotFoundError(
                "No behaviour of this repertoire was re-evaluated; do so with `ros2 run pga_me_ros reevaluate`, or "
                "leave by_mean false."
            )
        return seen

    def _statistics(self) -> Statistics | None:
        """Return what re-evaluations say; what cannot be read must not keep a behaviour from being served."""
        try:
            return self._known.of(self.archive, self.metrics.generation)
        except StorageError as error:
            self._node.get_logger().warning(str(error), once=True)
            return None

    def _of_cell(self, seen: EliteTable, cell: int, least: float) -> int:
        if 0 <= cell < self.archive.cells and not seen.filled[cell]:
            if self.archive.filled[cell]:
                raise NotFoundError(f"The behaviour of cell {cell} was not re-evaluated.")
            raise NotFoundError(f"Cell {cell} holds no behaviour; list_behaviors tells which do.")
        fitness = seen.elite(cell).fitness
        if fitness < least:
            raise NotFoundError(
                f"The behaviour of cell {cell} has fitness {fitness:.1f}, less than the "
                f"{least:.1f} that is required."
            )
        return cell

    def _nearest(
        self, request: GetBehavior.Request | GetBehaviors.Request, least: float, count: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the cells nearest to the wanted descriptor, and the distances of their elites to it."""
        _check_distance(request)
        farthest = request.max_distance if request.max_distance >= 0.0 else math.inf
        wanted = np.asarray(request.descriptor, np.float64)
        if wanted.size != self.archive.dimensions:
            raise RequestError(
                f"The descriptor has {wanted.size} entries; this repertoire's has "
                f"{self.archive.dimensions}: {', '.join(self._spec.descriptor_names)}."
            )
        seen = self._seen(request.by_mean)
        cells, distances = seen.nearest(wanted, count, farthest, least)
        if not len(cells):
            _at_least(seen, least)
            raise NotFoundError(
                f"No behaviour lies within {farthest:g} of {wanted.tolist()}"
                + (f" with a fitness of {least:.1f} or more." if least > -math.inf else ".")
            )
        return cells, distances

    def _list(self, request: ListBehaviors.Request, response: ListBehaviors.Response) -> None:
        if request.offset < 0 or not 1 <= request.limit <= PAGE:
            raise RequestError(
                f"offset is {request.offset} and limit {request.limit}; expected offset from 0 on "
                f"and limit from 1 to {PAGE}."
            )
        least = _least_fitness(request)
        try:
            seen = self._seen(request.by_mean)
        except NotFoundError as reason:
            response.message = str(reason)
            return
        cells = seen.filled_cells()
        cells = cells[seen.fitness[cells] >= least]
        fittest_first = cells[np.argsort(-seen.fitness[cells], kind="stable")]
        page = fittest_first[request.offset : request.offset + request.limit]
        response.total = len(cells)
        known = self._statistics()
        response.behaviors = [behavior_to_msg(self.archive.elite(c), known) for c in page.tolist()]
        self._node.count_done()

    def _get_info(self, _: GetInfo.Request, response: GetInfo.Response) -> GetInfo.Response:
        response.run_id = self._info.run_id
        response.task = self._spec.name
        response.archive = self.archive.kind
        response.descriptor_names = list(self._spec.descriptor_names)
        response.descriptor_low = flat(self.archive.low, "d")
        response.descriptor_high = flat(self.archive.high, "d")
        response.metrics = self.metrics
        response.settings = json.dumps(dict(self._info.settings))
        response.versions = json.dumps(dict(self._info.versions))
        response.growing = self._growing
        return response


def _at_least(seen: EliteTable, least: float) -> np.ndarray:
    """Return the cells whose elites have a least fitness.

    Raises:
        NotFoundError: There are none.
    """
    cells = seen.filled_cells()
    if not len(cells):
        raise NotFoundError("The repertoire is still empty; ask again after its first generation.")
    cells = cells[seen.fitness[cells] >= least]
    if not len(cells):
        raise NotFoundError(
            f"No behaviour has a fitness of {least:.1f} or more; the best has {seen.max_fitness:.1f}."
        )
    return cells


def _check_distance(request: GetBehavior.Request | GetBehaviors.Request) -> None:
    if math.isnan(request.max_distance):
        raise RequestError("max_distance is NaN; give a number, negative for any distance.")


def _least_fitness(
    request: GetBehavior.Request | GetBehaviors.Request | ListBehaviors.Request,
) -> float:
    if not request.require_fitness:
        return -math.inf
    if math.isnan(request.min_fitness):
        raise RequestError("min_fitness is NaN; give a number, or leave require_fitness false.")
    return float(request.min_fitness)
