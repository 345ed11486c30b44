"""What other robot nodes may ask about a repertoire: get_behavior, list_behaviors, get_info."""

from __future__ import annotations

import json
import math

import numpy as np
from pga_me_msgs.msg import Metrics as MetricsMsg
from pga_me_msgs.srv import GetBehavior, GetInfo, ListBehaviors

from pga_me_ros.core.archive import Archive
from pga_me_ros.core.elites import Elite
from pga_me_ros.core.errors import PgaError, RequestError
from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.run_info import RunInfo
from pga_me_ros.ros import names
from pga_me_ros.ros.convert import behavior_to_msg, controller_to_msg, flat
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.tasks.spec import TaskSpec

PAGE = 10_000
"""Most elites in one answer of list_behaviors."""


class NotFoundError(PgaError):
    """No elite fits the request, though it was understood."""


class RepertoireServices:
    """The services that only read.

    Args:
        node: Node that offers them.
        info: Description of the run in the repertoire file.
        archive: The archive; replace the attribute when it is another object.
        growing: Whether a run adds to it.

    Attributes:
        metrics: Newest metrics, for get_info; to be replaced when the archive has changed.
    """

    def __init__(self, node: GraphNode, info: RunInfo, archive: Archive, growing: bool) -> None:
        self.archive = archive
        self._node = node
        self._info = info
        self._growing = growing
        self._spec = TaskSpec.from_json(info.task)
        self._shape = MlpShape(tuple(info.layer_sizes))
        self.metrics = MetricsMsg()
        # What a robot tries next is no part of the run, so it need not be repeatable.
        self._any = np.random.default_rng()
        node.serve(GetBehavior, names.GET_BEHAVIOR, self._get_behavior, ok_field="found")
        node.serve(ListBehaviors, names.LIST_BEHAVIORS, self._list, ok_field="ok")
        node.create_service(GetInfo, names.GET_INFO, self._get_info)

    def _get_behavior(self, request: GetBehavior.Request, response: GetBehavior.Response) -> None:
        try:
            elite, distance = self._choose(request)
        except NotFoundError as reason:  # an answer as good as any, no fault of the asker's
            response.found, response.message = False, str(reason)
            return
        response.behavior = behavior_to_msg(elite)
        response.distance = distance
        response.controller = controller_to_msg(elite.parameters, self._shape, self._spec)
        self._node.count_done()

    def _choose(self, request: GetBehavior.Request) -> tuple[Elite, float]:
        """Return the elite that a request selects, and its distance to the wanted descriptor.

        Raises:
            RequestError: The request makes no sense.
            ArchiveError: Its descriptor or cell does not fit the archive.
            NotFoundError: No elite fits.
        """
        least = _least_fitness(request)
        if math.isnan(request.max_distance):
            raise RequestError("max_distance is NaN; give a number, negative for any distance.")
        if request.select == GetBehavior.Request.DESCRIPTOR:
            return self._nearest(request, least)
        if request.select == GetBehavior.Request.CELL:
            return self._of_cell(request.cell, least), 0.0
        if request.select == GetBehavior.Request.BEST:
            self._at_least(least)
            return self.archive.best(), 0.0
        if request.select == GetBehavior.Request.RANDOM:
            return self.archive.elite(int(self._any.choice(self._at_least(least)))), 0.0
        raise RequestError(
            f"select is {request.select}; expected 0 (descriptor), 1 (cell), 2 (best) or 3 (random)."
        )

    def _of_cell(self, cell: int, least: float) -> Elite:
        if 0 <= cell < self.archive.cells and not self.archive.filled[cell]:
            raise NotFoundError(f"Cell {cell} holds no behaviour; list_behaviors tells which do.")
        elite = self.archive.elite(cell)
        if elite.fitness < least:
            raise NotFoundError(
                f"The behaviour of cell {cell} has fitness {elite.fitness:.1f}, less than the "
                f"{least:.1f} that is required."
            )
        return elite

    def _nearest(self, request: GetBehavior.Request, least: float) -> tuple[Elite, float]:
        farthest = request.max_distance if request.max_distance >= 0.0 else math.inf
        wanted = np.asarray(request.descriptor, np.float64)
        if wanted.size != self.archive.dimensions:
            raise RequestError(
                f"The descriptor has {wanted.size} entries; this repertoire's has "
                f"{self.archive.dimensions}: {', '.join(self._spec.descriptor_names)}."
            )
        cells, distances = self.archive.nearest(wanted, 1, farthest, least)
        if not len(cells):
            self._at_least(least)
            raise NotFoundError(
                f"No behaviour lies within {farthest:g} of {wanted.tolist()}"
                + (f" with a fitness of {least:.1f} or more." if least > -math.inf else ".")
            )
        return self.archive.elite(int(cells[0])), float(distances[0])

    def _at_least(self, least: float) -> np.ndarray:
        """Return the cells whose elites have a least fitness.

        Raises:
            NotFoundError: There are none.
        """
        cells = self.archive.filled_cells()
        if not len(cells):
            raise NotFoundError(
                "The repertoire is still empty; ask again after its first generation."
            )
        cells = cells[self.archive.fitness[cells] >= least]
        if not len(cells):
            raise NotFoundError(
                f"No behaviour has a fitness of {least:.1f} or more; the best has "
                f"{self.archive.max_fitness:.1f}."
            )
        return cells

    def _list(self, request: ListBehaviors.Request, response: ListBehaviors.Response) -> None:
        if request.offset < 0 or not 1 <= request.limit <= PAGE:
            raise RequestError(
                f"offset is {request.offset} and limit {request.limit}; expected offset from 0 on "
                f"and limit from 1 to {PAGE}."
            )
        cells = self.archive.filled_cells()
        cells = cells[self.archive.fitness[cells] >= _least_fitness(request)]
        fittest_first = cells[np.argsort(-self.archive.fitness[cells], kind="stable")]
        page = fittest_first[request.offset : request.offset + request.limit]
        response.total = len(cells)
        response.behaviors = [behavior_to_msg(self.archive.elite(c)) for c in page.tolist()]
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


def _least_fitness(request: GetBehavior.Request | ListBehaviors.Request) -> float:
    if not request.require_fitness:
        return -math.inf
    if math.isnan(request.min_fitness):
        raise RequestError("min_fitness is NaN; give a number, or leave require_fitness false.")
    return float(request.min_fitness)
