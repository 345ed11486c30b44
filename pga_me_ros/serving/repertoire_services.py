"""What other robot nodes may ask about a repertoire: get_behavior, get_behaviors, list_behaviors, get_info."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from pga_me_msgs.msg import Metrics as MetricsMsg
from pga_me_msgs.srv import GetBehavior, GetBehaviors, GetInfo, ListBehaviors

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.choosing import Choices, NotFoundError
from pga_me_ros.core.archive.elite_table import EliteTable
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.reevaluations import Statistics
from pga_me_ros.core.storage.run_info import RunInfo
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import behavior_to_msg, controller_to_msg, flat
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.serving.known_statistics import KnownStatistics
from pga_me_ros.tasks.spec import TaskSpec

PAGE = 10_000
"""Most elites in one answer of list_behaviors."""

MOST = 1000
"""Most elites in one answer of get_behaviors, which may hold their controllers."""


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
            cells, distances = self._nearest(request, request.count)
        except NotFoundError as reason:
            response.message = str(reason)
            return
        known = self._statistics()
        elites = [self.archive.elite(cell) for cell in cells.tolist()]
        response.behaviors = [behavior_to_msg(elite, known) for elite in elites]
        response.distances = flat(distances, "d")
        if request.with_controllers:
            response.controller = controller_to_msg(
                np.empty(0, np.float32), self._shape, self._spec
            )
            response.parameters = flat(self.archive.parameters[cells], "f")
        self._node.count_done()

    def _choose(self, request: GetBehavior.Request) -> tuple[int, float]:
        """Return the cell that a request selects, and its elite's distance to the wanted descriptor.

        Raises:
            RequestError: The request makes no sense.
            ArchiveError: Its descriptor or cell does not fit the archive.
            NotFoundError: No elite fits.
        """
        if request.select == GetBehavior.Request.DESCRIPTOR:
            cells, distances = self._nearest(request, 1)
            return int(cells[0]), float(distances[0])
        _check_distance(request)
        choices = self._choices(request)
        if request.select == GetBehavior.Request.CELL:
            return choices.of_cell(request.cell), 0.0
        if request.select == GetBehavior.Request.BEST:
            return choices.fittest(), 0.0
        if request.select == GetBehavior.Request.RANDOM:
            return choices.any(self._any), 0.0
        raise RequestError(
            f"select is {request.select}; expected 0 (descriptor), 1 (cell), 2 (best) or 3 (random)."
        )

    def _choices(
        self, request: GetBehavior.Request | GetBehaviors.Request | ListBehaviors.Request
    ) -> Choices:
        """Return the elites to choose from, judged as a request wants them.

        Raises:
            RequestError: By their means, but the file of re-evaluations cannot be used; or a limit is NaN.
            NotFoundError: By their means, but none was re-evaluated.
        """
        least = _least_fitness(request)
        elites: EliteTable = self.archive
        if request.by_mean:
            try:
                known = self._known.of(self.archive, self.metrics.generation)
            except StorageError as error:
                raise RequestError(f"by_mean cannot be answered: {error}") from None
            elites = known.as_elites(self.archive)
        return Choices(self.archive, elites, self._spec.descriptor_names, least)

    def _statistics(self) -> Statistics | None:
        """Return what re-evaluations say; what cannot be read must not keep a behavior from being served."""
        try:
            return self._known.of(self.archive, self.metrics.generation)
        except StorageError as error:
            self._node.get_logger().warning(str(error), once=True)
            return None

    def _nearest(
        self, request: GetBehavior.Request | GetBehaviors.Request, count: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the cells nearest to the wanted descriptor, and the distances of their elites to it."""
        _check_distance(request)
        farthest = request.max_distance if request.max_distance >= 0.0 else math.inf
        return self._choices(request).nearest(request.descriptor, count, farthest)

    def _list(self, request: ListBehaviors.Request, response: ListBehaviors.Response) -> None:
        if request.offset < 0 or not 1 <= request.limit <= PAGE:
            raise RequestError(
                f"offset is {request.offset} and limit {request.limit}; expected offset from 0 on "
                f"and limit from 1 to {PAGE}."
            )
        try:
            choices = self._choices(request)
        except NotFoundError as reason:
            response.message = str(reason)
            return
        fitness = choices.elites.fitness
        cells = choices.elites.filled_cells()
        cells = cells[fitness[cells] >= choices.min_fitness]
        fittest_first = cells[np.argsort(-fitness[cells], kind="stable")]
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
