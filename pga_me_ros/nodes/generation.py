"""The generation loop of the graph: Alg. 3 with evaluation, critic training and variation side by side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pga_me_msgs.msg import Metrics
from pga_me_msgs.srv import AddToArchive, Propose, SampleParents

from pga_me_ros.core.elites import NO_PARENT, Operator
from pga_me_ros.core.errors import PgaError
from pga_me_ros.core.policy import MlpShape
from pga_me_ros.core.schedule import (
    TrainingOrder,
    evaluation_ids,
    must_end_within,
    training_for,
    training_meanwhile,
)
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.systems import Slots, system_of
from pga_me_ros.nodes.caller import Waiter, accepted, call
from pga_me_ros.nodes.critic_side import CriticSide
from pga_me_ros.nodes.evaluator_pool import EvaluatorPool
from pga_me_ros.nodes.loop_clients import LoopClients
from pga_me_ros.ros.convert import flat, rates_to_msg, shaped

PIECE = 25
"""Offspring per request: evaluators start on the first ones while the next are made."""

ON_THE_WAY = (0.02, 1.0)
"""Seconds that parents which are published again get to arrive: the first time, and at most; it doubles in between."""

WITHOUT_CRITICS = (Operator.RANDOM, Operator.IMPORTED, Operator.GA)
"""Operators that need no critics of their generation."""


@dataclass
class Batch:
    """Controllers of one generation.

    Attributes:
        ids: Their evaluation ids.
        operators: (b,) uint8 values of `Operator`.
        parents: (b, 2) int64 evaluation ids of the parents, `NO_PARENT` for none.
        parameters: (b, P) float32.
    """

    ids: range
    operators: NDArray[np.uint8]
    parents: NDArray[np.int64]
    parameters: NDArray[np.float32]

    @classmethod
    def empty(cls, ids: range, parameter_count: int) -> Batch:
        """Return a batch that is still to be filled."""
        b = len(ids)
        return cls(
            ids,
            np.zeros(b, np.uint8),
            np.full((b, 2), NO_PARENT, np.int64),
            np.empty((b, parameter_count), np.float32),
        )


class GenerationLoop:
    """Carries out one generation after the other.

    Whatever is asked of a node depends on the request alone or on what was committed before, so a node that dies is
    asked again after its restart, and the result is the same.

    Args:
        run_id: Id of the run.
        shape: Layers of the controllers.
        clients: Services of the other nodes.
        pool: Evaluators.
        critics: The critic trainer's side.
        waiter: How to wait.
        imported: (n, P) float32 controllers that the run starts with in place of random ones.
    """

    def __init__(
        self,
        run_id: str,
        shape: MlpShape,
        clients: LoopClients,
        pool: EvaluatorPool,
        critics: CriticSide,
        waiter: Waiter,
        imported: NDArray[np.float32],
    ) -> None:
        self._run_id = run_id
        self._shape = shape
        self._clients = clients
        self._pool = pool
        self._critics = critics
        self._waiter = waiter
        self._imported = imported

    def run(self, settings: Settings, before: Settings, t: int) -> Metrics:
        """Make, evaluate and add generation t; meanwhile train for the next.

        Args:
            settings: Settings with the rates in force.
            before: Settings with the rates of the generation before.
            t: Number of the generation; all before it are committed.

        Returns:
            Metrics of the archive after it.
        """
        batch = Batch.empty(evaluation_ids(settings, t), self._shape.parameter_count)
        system = system_of(settings)
        self._pool.begin(t, system.exploration_sigma(settings, t))
        trained = training_for(settings, before, t)
        if trained and not self._critics.has(trained):
            self._critics.start(trained)  # nothing new where it is under way
        meanwhile = training_meanwhile(settings, t)
        if trained and meanwhile:
            self._critics.start_after(meanwhile, trained)
        plan = system.batch_plan(settings, t, len(self._imported))
        for slots in plan:  # what needs no critics is evaluated while they still train
            if slots.operator in WITHOUT_CRITICS:
                self._fill(settings, t, batch, slots, trained)
        if trained:
            self._critics.wait_for(trained)
        if meanwhile:
            self._critics.start(meanwhile)  # nothing new where it has followed
        for slots in plan:
            if slots.operator not in WITHOUT_CRITICS:
                self._fill(settings, t, batch, slots, trained)
        self._wait_for_results(batch)
        self._critics.store(t, batch.ids)
        if meanwhile and must_end_within(settings, t):
            self._critics.wait_for(meanwhile)
        return self._add(settings, t, batch)

    def _fill(
        self,
        settings: Settings,
        t: int,
        batch: Batch,
        slots: Slots,
        trained: TrainingOrder | None,
    ) -> None:
        """Have offspring made and send each piece to the evaluators at once."""
        end = slots.first + slots.count
        for first in range(slots.first, end, PIECE):
            places = slice(first, min(first + PIECE, end))
            n = places.stop - first
            batch.operators[places] = slots.operator
            if slots.operator == Operator.GREEDY:
                batch.parameters[places] = self._critics.greedy(t)
            elif slots.operator == Operator.IMPORTED:
                batch.parameters[places] = self._imported[batch.ids[places]]
            else:
                each = system_of(settings).parents.get(slots.operator, 0)
                request = self._proposal(settings, t, slots, first, n)
                if each:
                    batch.parents[places, :each] = self._sample(request, each)
                    request.parents = flat(batch.parents[places, :each], "q")
                batch.parameters[places] = self._propose(request, each, trained)
            self._pool.submit(batch.ids[places], batch.parameters[places])

    def _sample(
        self, proposal: Propose.Request, each: int, *, publish: bool = False
    ) -> NDArray[np.int64]:
        """Return the evaluation ids (n, each) of parents for what is to be proposed."""
        request = SampleParents.Request(
            run_id=self._run_id,
            generation=proposal.generation,
            first=proposal.first,
            count=proposal.count,
            parents_each=each,
            publish=publish,
        )
        response = accepted(self._waiter, self._clients.sample_parents, request)
        return shaped(response.evaluations, (proposal.count, each), np.int64, "evaluations")

    def _proposal(
        self, settings: Settings, t: int, slots: Slots, first: int, n: int
    ) -> Propose.Request:
        request = Propose.Request(
            run_id=self._run_id, generation=t, operator_id=int(slots.operator), first=first, count=n
        )
        request.rates = rates_to_msg(settings)
        return request

    def _propose(
        self, request: Propose.Request, each: int, trained: TrainingOrder | None
    ) -> NDArray[np.float32]:
        """Return the parameters (n, P) of offspring."""
        pause, longest = ON_THE_WAY
        while True:
            response = call(self._waiter, self._clients.propose, request)
            if response.accepted:
                size = (request.count, self._shape.parameter_count)
                return shaped(response.parameters, size, np.float32, "parameters")
            if response.lacking:  # a variation node that was restarted, or is about to hear them
                self._sample(request, each, publish=True)
                self._waiter.pause(pause)
                pause = min(2.0 * pause, longest)
            elif response.again and trained:
                self._critics.remind(trained)
            else:
                raise PgaError(f"The variation node refused: {response.message}")

    def _wait_for_results(self, batch: Batch) -> None:
        self._waiter.until(lambda: self._pool.done(batch.ids))

    def _add(self, settings: Settings, t: int, batch: Batch) -> Metrics:
        """Commit the generation to the archive."""
        outcomes = self._pool.outcomes(batch.ids)
        request = AddToArchive.Request(run_id=self._run_id, generation=t)
        request.operators = batch.operators.tolist()
        request.parents = flat(batch.parents, "q")
        request.fitness = flat([o.fitness for o in outcomes], "d")
        request.descriptors = flat([o.descriptor for o in outcomes], "d")
        request.steps = flat([o.steps for o in outcomes], "q")
        request.terminated = [o.terminated for o in outcomes]
        request.parameters = flat(batch.parameters, "f")
        request.rates = rates_to_msg(settings)
        return accepted(self._waiter, self._clients.add_to_archive, request).metrics
