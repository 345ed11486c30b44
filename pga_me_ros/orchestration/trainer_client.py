"""The generation loop's client of the critic trainer."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from pga_me_msgs.msg import CriticSnapshot
from pga_me_msgs.srv import GetBehavior, StoreExperience, Train

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.algorithms.snapshot_fit import require_fit
from pga_me_ros.core.plan import TrainingOrder
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import GREEDY, Snapshot
from pga_me_ros.errors import PgaError
from pga_me_ros.orchestration.calls import LoopClients, Waiter, accepted, call
from pga_me_ros.orchestration.control import Control
from pga_me_ros.orchestration.evaluator_pool import EvaluatorPool
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import flat, rates_to_msg, snapshot_from_msg
from pga_me_ros.tasks.spec import TaskSpec

ARRIVAL = 1.0
"""Seconds that episodes get to arrive after their evaluation was answered, before it is repeated."""

ROUNDS = 10
"""Maximum attempts to collect the experience of a generation."""

ASK_AGAIN = 2.0
"""Seconds after which a training is requested again: it may have failed, or its snapshot may be lost."""

REMINDER = 0.2
"""Seconds between two requests for a snapshot that a node still waits for."""


class TrainerClient:
    """Starts trainings, waits for their snapshots, and makes sure that no experience is lost.

    Args:
        node: The orchestrator's node.
        run_id: Id of the run.
        spec: Task of the run.
        settings: Settings of the run.
        clients: Services of the other nodes.
        pool: Evaluators, to repeat evaluations whose experience was lost.
        waiter: Waits for the trainer.
        incarnation: Returns the trainer's process id, which changes when it is restarted.
    """

    def __init__(
        self,
        node: Control,
        run_id: str,
        spec: TaskSpec,
        settings: Settings,
        clients: LoopClients,
        pool: EvaluatorPool,
        waiter: Waiter,
        incarnation: Callable[[], int | None],
    ) -> None:
        self._node = node
        self._run_id = run_id
        self._spec = spec
        self._settings = settings
        self._clients = clients
        self._pool = pool
        self._waiter = waiter
        self._incarnation = incarnation
        self._snapshots: dict[int, Snapshot] = {}
        self._ordered: set[int] = set()
        self.reevaluations = 0
        node.create_subscription(CriticSnapshot, names.SNAPSHOT, self._take, qos.LATCHED)
        self._best = node.create_client(GetBehavior, names.GET_BEHAVIOR, qos_profile=qos.CLIENT)

    def greedy(self, generation: int) -> Float32Array:
        """Return the greedy controller (P,) of a generation whose snapshot has arrived."""
        return self._snapshots[generation].parameters(GREEDY)

    def has(self, order: TrainingOrder) -> bool:
        """Whether the snapshot of a training that was started here has arrived."""
        return order.generation in self._snapshots

    def start(self, order: TrainingOrder) -> None:
        """Start a training; if it was done before, its snapshot is published again."""
        accepted(self._waiter, self._clients.train, self._request(order))

    def start_after(self, order: TrainingOrder, before: TrainingOrder) -> None:
        """Have a training start as soon as the one before it is done.

        A restarted trainer refuses this until the one before has been started again; `start` is needed then.
        """
        request = self._request(order)
        request.after = before.generation
        call(self._waiter, self._clients.train, request)

    def _request(self, order: TrainingOrder) -> Train.Request:
        """Return the request for a training, and expect its snapshot from now on."""
        settings = self._settings.with_rates(order.rates)
        request = Train.Request(
            run_id=self._run_id, generation=order.generation, experience=order.experience
        )
        request.rates = rates_to_msg(settings)
        if settings.greedy_init == "best":
            request.greedy = self._best_controller()
        newest = max(self._ordered, default=0)
        self._ordered = {g for g in self._ordered if g >= newest - 1} | {order.generation}
        return request

    def wait_for(self, order: TrainingOrder) -> None:
        """Wait until a training's snapshot has arrived, and start the training again if its node died."""
        asked_of: int | None = 0

        def came_or_died() -> bool:
            return self.has(order) or asked_of != self._incarnation()

        while not self.has(order):
            asked_of = self._incarnation()
            self.start(order)
            self._waiter.until(came_or_died, ASK_AGAIN)

    def remind(self, order: TrainingOrder) -> None:
        """Have a snapshot published again after a while, for a node that was restarted and missed it."""
        self._waiter.pause(REMINDER)
        self.start(order)

    def store(self, generation: int, ids: Sequence[int]) -> None:
        """Have a generation's experience stored; repeat evaluations whose episodes did not arrive."""
        request = StoreExperience.Request(run_id=self._run_id, generation=generation)
        for _ in range(ROUNDS):
            request.fitness = flat([o.fitness for o in self._pool.outcomes(ids)], "d")
            response = call(self._waiter, self._clients.store_experience, request)
            if response.accepted:
                return
            if response.missing:
                response = self._after_a_while(request)
            if response.accepted:
                return
            if not response.missing:
                raise PgaError(f"The critic trainer refused to store: {response.message}")
            missing = [k for k in response.missing if k in ids]
            self._node.get_logger().warning(
                f"the experience of {len(missing)} evaluations was lost; they are repeated"
            )
            self.reevaluations += len(missing)
            self._pool.repeat(missing)
            self._waiter.until(lambda: self._pool.done(missing))  # noqa: B023
        raise PgaError(
            f"The experience of evaluations {missing} did not arrive in {ROUNDS} attempts. Either the critic trainer "
            "does not hear the evaluators (is their network up?), or an evaluation gives another fitness each time: "
            f"check the task with python -m pga_me_ros.tasks.check {self._settings.task}"
        )

    def _after_a_while(self, request: StoreExperience.Request) -> StoreExperience.Response:
        """Repeat the request for a while: the last episodes may still be on their way."""
        for pause in (0.01, 0.02, 0.05, 0.1, 0.2, ARRIVAL):
            self._waiter.pause(pause)
            response = call(self._waiter, self._clients.store_experience, request)
            if response.accepted or not response.missing:
                break
        return response

    def _best_controller(self) -> object:
        # By single evaluations, as in `core.search`: re-evaluations change nothing in a run.
        request = GetBehavior.Request(select=GetBehavior.Request.BEST, single=True)
        response = call(self._waiter, self._best, request)
        if not response.found:
            raise PgaError(f"The greedy controller has no start: {response.message}")
        return flat(np.asarray(response.controller.parameters, np.float32), "f")

    def _take(self, msg: CriticSnapshot) -> None:
        if msg.run_id != self._run_id or msg.generation not in self._ordered:
            return  # of another run, or of a training not started here; one that is ordered later comes again
        try:
            snapshot = snapshot_from_msg(msg)
            require_fit(snapshot, self._spec, self._settings)
        except PgaError as error:
            self._node.refused(f"dropped a critic snapshot: {error}")
            return
        self._snapshots[snapshot.generation] = snapshot
        for old in [g for g in self._snapshots if g < snapshot.generation - 1]:
            del self._snapshots[old]
        self._waiter.wake()
