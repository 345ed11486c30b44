"""The services of a repertoire for other nodes: to choose and list behaviors, to list generations, and get_info.

`ActorService` adds get_actor.
"""

from __future__ import annotations

import json

import numpy as np
from pga_me_msgs.msg import Behavior as BehaviorMsg
from pga_me_msgs.msg import Metrics as MetricsMsg
from pga_me_msgs.srv import GetBehavior, GetBehaviors, GetInfo, ListBehaviors, ListGenerations

from pga_me_ros.core.archive.archive import Archive
from pga_me_ros.core.archive.choosing import Choices, Judging, NotFoundError
from pga_me_ros.core.archive.corrected import CorrectedMetrics
from pga_me_ros.core.archive.statistics import Statistics
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.repertoire import Repertoire
from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import behavior_to_msg, controller_to_msg, flat
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.serving.actor_service import ActorService
from pga_me_ros.serving.asked_for import demands_of, farthest, require_one_way
from pga_me_ros.serving.generations import list_generations
from pga_me_ros.serving.known_statistics import KnownStatistics
from pga_me_ros.tasks.spec import TaskSpec

PAGE = 10_000
"""Most elites in one answer of list_behaviors."""

MOST = 1000
"""Most elites in one answer of get_behaviors, which may hold their controllers."""


class RepertoireServices:
    """The read-only services.

    Args:
        node: Node that offers them.
        file: The repertoire file, open.
        archive: The archive; set the attribute when another object replaces it.
        grow: Whether it was opened for a run that adds to it.

    Attributes:
        growing: Whether the run still adds to it, for get_info; set it to False when the run ends.
        metrics: Latest metrics, for get_info; set them when the archive changes.
    """

    def __init__(self, node: GraphNode, file: Repertoire, archive: Archive, grow: bool) -> None:
        self.archive = archive
        self._node = node
        self._file = file
        self._info = info = file.info
        self._grow = self.growing = grow
        self._known = KnownStatistics(file.path, info.run_id, archive.dimensions)
        self._spec = TaskSpec.from_json(info.task)
        self._shape = MlpShape(tuple(info.layer_sizes))
        self._actor = ActorService(node, info, self._spec, file.path)
        self.metrics = MetricsMsg()
        # Random choices for robots are not part of the run, so they need not be repeatable.
        self._any = np.random.default_rng()
        many = qos.ASKED_BY_MANY
        node.serve(GetBehavior, names.GET_BEHAVIOR, self._get_behavior, "found", many)
        node.serve(GetBehaviors, names.GET_BEHAVIORS, self._get_behaviors, "ok", many)
        node.serve(ListBehaviors, names.LIST_BEHAVIORS, self._list, "ok", many)
        node.serve(ListGenerations, names.LIST_GENERATIONS, self._generations, "ok", many)
        node.create_service(GetInfo, names.GET_INFO, self._get_info, qos_profile=many)

    def measures(self, generation: int) -> CorrectedMetrics | None:
        """Return the corrected metrics of the archive after a generation, None while they are unknown."""
        return self._known.measures(self.archive, generation, growing=self._grow)

    def in_words(self, name: str) -> str:
        """Return a one-line summary for the log.

        Args:
            name: Name of the repertoire.
        """
        behaviors = f"serves '{name}': {len(self.archive)} behaviors of {self._spec.name}"
        try:
            self._known.of(self.archive, self.metrics.generation)
        except StorageError as error:
            return f"{behaviors}; what they are worth on average is unknown: {error}"
        measured = self._known.measures(self.archive, self.metrics.generation, growing=False)
        if measured is None:
            return f"{behaviors}; not all were re-evaluated, so what they are worth on average is unknown"
        return f"{behaviors}; re-evaluated {measured.repeats} times or more, {100.0 * measured.fall_share:.1f} % falls"

    @property
    def outdated(self) -> bool:
        """Whether there are new re-evaluations that `metrics` does not include."""
        return self._known.changed()

    def _get_behavior(self, request: GetBehavior.Request, response: GetBehavior.Response) -> None:
        try:
            choices, cell, distance = self._choose(request)
        except NotFoundError as reason:  # a regular answer, not an error of the caller
            response.found, response.message = False, str(reason)
            return
        response.behavior = self._behavior(choices, cell)
        response.distance = distance
        if request.with_controller:
            parameters = self.archive.parameters[cell]
            response.controller = controller_to_msg(parameters, self._shape, self._spec)
        self._node.count_done()

    def _get_behaviors(
        self, request: GetBehaviors.Request, response: GetBehaviors.Response
    ) -> None:
        if not 1 <= request.count <= MOST:
            raise RequestError(f"count is {request.count}; expected 1 to {MOST}.")
        try:
            choices = self._choices(request)
            cells, distances = choices.nearest(request.descriptor, request.count, farthest(request))
        except NotFoundError as reason:
            response.message = str(reason)
            return
        response.behaviors = [self._behavior(choices, cell) for cell in cells.tolist()]
        response.distances = flat(distances, "d")
        if request.with_controllers:
            response.controller = controller_to_msg(
                np.empty(0, np.float32), self._shape, self._spec
            )
            response.parameters = flat(self.archive.parameters[cells], "f")
        self._node.count_done()

    def _behavior(self, choices: Choices, cell: int) -> BehaviorMsg:
        return behavior_to_msg(
            self.archive.elite(cell), choices.known, by_mean=choices.by_mean(cell)
        )

    def _choose(self, request: GetBehavior.Request) -> tuple[Choices, int, float]:
        """Return the candidates, the cell that a request selects, and its elite's distance to the wanted descriptor.

        Raises:
            RequestError: The request is invalid.
            ArchiveError: Its descriptor or cell does not fit the archive.
            NotFoundError: No elite fits.
        """
        way = require_one_way(request)
        choices = self._choices(request)
        if way == "descriptor":
            cells, distances = choices.nearest(request.descriptor, 1, farthest(request))
            return choices, int(cells[0]), float(distances[0])
        if way == "cell":
            return choices, choices.of_cell(request.cell), 0.0
        if way == "best":
            return choices, choices.fittest(), 0.0
        return choices, choices.any(self._any), 0.0

    def _choices(
        self, request: GetBehavior.Request | GetBehaviors.Request | ListBehaviors.Request
    ) -> Choices:
        """Return the elites to choose from, judged as the request demands.

        Raises:
            RequestError: The request demands means or a share of falls, but the file of re-evaluations cannot be used;
                or a limit is invalid.
            NotFoundError: The request demands means, but no elite was re-evaluated.
        """
        demands = demands_of(request)
        try:
            known = self._known.of(self.archive, self.metrics.generation)
        except StorageError as error:
            asked = {
                "by_mean": demands.judging is Judging.MEAN,
                "max_fall_share": demands.limits_falls,
            }
            if demanded := " and ".join(name for name, is_asked in asked.items() if is_asked):
                raise RequestError(f"{demanded} cannot be answered: {error}") from None
            # Behaviors can be served without the re-evaluations.
            self._node.get_logger().warning(str(error), once=True)
            known = Statistics.none(self.archive.cells, self.archive.dimensions)
        return Choices(self.archive, known, self._spec.descriptor_names, demands)

    def _list(self, request: ListBehaviors.Request, response: ListBehaviors.Response) -> None:
        if request.offset < 0 or not 1 <= request.limit <= PAGE:
            raise RequestError(
                f"offset is {request.offset} and limit {request.limit}; expected offset from 0 on "
                f"and limit from 1 to {PAGE}."
            )
        try:
            choices = self._choices(request)
            fittest_first = choices.fittest_first()
        except NotFoundError as reason:
            response.message = str(reason)
            return
        page = fittest_first[request.offset : request.offset + request.limit]
        response.total = len(fittest_first)
        response.behaviors = [self._behavior(choices, cell) for cell in page.tolist()]
        self._node.count_done()

    def _generations(
        self, request: ListGenerations.Request, response: ListGenerations.Response
    ) -> None:
        last = self.metrics.generation
        corrected = self._known.stored_measures()
        if measured := self.measures(last):
            corrected[last] = measured
        list_generations(self._file, self.archive.cells, corrected, request, response)
        response.total = last + 1
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
        response.growing = self.growing
        return response
