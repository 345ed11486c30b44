"""Variation: makes random controllers, and offspring by GA and PG variation (Alg. 5)."""

from __future__ import annotations

import os
from importlib.metadata import version

import numpy as np
from pga_me_msgs.msg import CriticSnapshot, Elites
from pga_me_msgs.srv import Propose

from pga_me_ros.core.algorithms import algorithm_of
from pga_me_ros.core.algorithms.snapshot_fit import require_fit
from pga_me_ros.core.archive.make_archive import cell_count
from pga_me_ros.core.networks.conditioned import conditions
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.operators import OPERATORS, Operator, needs_snapshot
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.variation.make_offspring import MAKERS, OffspringRequest, make_offspring
from pga_me_ros.errors import PgaError, RequestError
from pga_me_ros.process.ending import leave
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.command_line import Program
from pga_me_ros.ros.convert import flat, shaped, snapshot_from_msg, with_rates
from pga_me_ros.ros.elites_topic import EliteMirror
from pga_me_ros.ros.graph_node import GraphNode
from pga_me_ros.ros.options import ChildOptions, require_run
from pga_me_ros.ros.parameters import declare_run
from pga_me_ros.ros.process import run_node
from pga_me_ros.tasks.registry import task_spec

KEPT = 3
"""Number of critic snapshots that are kept; two are in use at a time."""

NOTICE = 10.0
"""Seconds between two log lines while waiting for a snapshot."""


class Variation(GraphNode):
    """Makes the controllers that the orchestrator requests, from parents and the newest critic snapshot."""

    def __init__(self) -> None:
        super().__init__("variation")
        self._settings, options = declare_run(self, ChildOptions, fixed=True)
        self._run_id = require_run(options, "variation")
        self._spec = task_spec(self._settings.task)
        self._shape = controller_shape(self._spec, self._settings)
        self._algorithm = algorithm_of(self._settings)
        own = (*self._algorithm.operators, Operator.RANDOM)
        self._operators = [o for o in MAKERS if o in own]
        self._snapshots: dict[int, Snapshot] = {}
        self._answered: tuple[Propose.Request, Propose.Response] | None = None
        self._elites = EliteMirror(
            cell_count(self._spec, self._settings),
            self._shape.parameter_count,
            self._spec.descriptor_dim,
        )
        self.create_subscription(CriticSnapshot, names.SNAPSHOT, self._take_snapshot, qos.LATCHED)
        self.create_subscription(Elites, names.ELITES, self._take_elites, qos.ELITES)
        self.serve(Propose, names.PROPOSE, self._propose)
        self.start_heartbeat(
            run_id=self._run_id, task=self._settings.task, versions=f"torch {version('torch')}"
        )

    def _take_snapshot(self, msg: CriticSnapshot) -> None:
        try:
            self.check_run(msg.run_id, self._run_id)
            snapshot = snapshot_from_msg(msg)
            require_fit(snapshot, self._spec, self._settings)
        except PgaError as error:
            self.refused(f"dropped a critic snapshot: {error}")
        else:
            # The next generation's snapshot may come while offspring of this one are still being made. The latest are
            # kept, not the highest numbers: a missing one can be requested again, and a stray one is never used.
            self._snapshots.pop(snapshot.generation, None)
            self._snapshots[snapshot.generation] = snapshot
            while len(self._snapshots) > KEPT:
                del self._snapshots[next(iter(self._snapshots))]

    def _take_elites(self, msg: Elites) -> None:
        try:
            self.check_run(msg.run_id, self._run_id)
            self._elites.hear(msg)
        except PgaError as error:
            self.refused(f"dropped elites: {error}")

    def _propose(self, request: Propose.Request, response: Propose.Response) -> None:
        if self._answered and request == self._answered[0]:
            # The orchestrator repeats a slow request; making the same offspring again would only add to the delay.
            response.parameters = self._answered[1].parameters
            response.intended_descriptors = self._answered[1].intended_descriptors
            return
        self.check_run(request.run_id, self._run_id)
        settings = with_rates(self._settings, request.rates)
        self._check_places(request)
        operator = self._operator(request)
        each = OPERATORS[operator].parents
        ids = shaped(request.parents, (request.count, each), np.int64, "parents")
        snapshot = None
        if needs_snapshot(operator, request.generation):
            snapshot = self._snapshots.get(request.generation)
            if snapshot is None:
                self._put_off(
                    response,
                    f"Offspring of generation {request.generation} need its critic snapshot; here are those of "
                    f"{sorted(self._snapshots)}. Ask again once it has been published.",
                )
                return
        aimed = self._algorithm.conditioned and settings.extracted
        lacking = self._elites.lacking(ids, request.generation - 1 if aimed else -1)
        if lacking:
            response.lacking = lacking
            self._put_off(
                response,
                f"Parents {lacking} are not among the elites received so far; have {names.SAMPLE_PARENTS} publish "
                "them, then ask again.",
            )
            return
        aims = self._algorithm.intended(operator, self._elites.descriptors(ids))
        wanted = OffspringRequest(
            settings,
            self._shape,
            request.generation,
            request.first,
            request.count,
            self._elites.parameters(ids),
            snapshot,
            os.cpu_count() or 1,
            None if aims is None else conditions(aims, self._spec),
        )
        response.parameters = flat(make_offspring(operator, wanted), "f")
        response.intended_descriptors = flat(() if aims is None else aims, "d")
        self._answered = (request, response)
        self.count_done(request.count)

    def _operator(self, request: Propose.Request) -> Operator:
        if request.operator_id not in self._operators:
            known = ", ".join(f"{operator:d}" for operator in self._operators)
            raise RequestError(
                f"Operator {request.operator_id} is unknown; expected one of {known}."
            )
        return Operator(request.operator_id)

    def _put_off(self, response: Propose.Response, reason: str) -> None:
        """Answer that something has yet to arrive; this is not a refusal, as the request is valid."""
        response.accepted, response.again, response.message = False, True, reason
        self.get_logger().info(reason, throttle_duration_sec=NOTICE)

    def _check_places(self, request: Propose.Request) -> None:
        b = self._settings.batch_size
        if request.generation < 0 or request.first < 0 or request.count < 1:
            raise RequestError("generation and first must be at least 0, count at least 1.")
        if request.first + request.count > b:
            raise RequestError(
                f"Places {request.first} to {request.first + request.count - 1} were requested, but a "
                f"batch has places 0 to {b - 1}."
            )


PROGRAM = Program(
    "variation",
    "Makes offspring by GA and PG variation for a run; the orchestrator starts it.",
    (Settings, ChildOptions),
)


def main() -> int:
    """Run the variation node."""
    return run_node(PROGRAM, Variation)


if __name__ == "__main__":
    leave(main())
