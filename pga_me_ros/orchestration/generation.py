"""The generation loop of the graph: Alg. 3 with evaluation, critic training and variation in parallel."""

from __future__ import annotations

import numpy as np
from pga_me_msgs.msg import Metrics
from pga_me_msgs.srv import AddToArchive, Extract, Propose, SampleParents

from pga_me_ros.arrays import Float32Array, Float64Array, Int64Array
from pga_me_ros.core.algorithms import Slots
from pga_me_ros.core.batch import Batch
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.operators import OPERATORS, Operator
from pga_me_ros.core.plan import GenerationPlan
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import PgaError
from pga_me_ros.orchestration.calls import LoopClients, Waiter, accepted, call
from pga_me_ros.orchestration.evaluator_pool import EvaluatorPool
from pga_me_ros.orchestration.trainer_client import TrainerClient
from pga_me_ros.ros.convert import finite, flat, rates_to_msg, shaped

PIECE = 25
"""Offspring per request: evaluators start with the first ones while the next are made."""

ON_THE_WAY = (0.02, 1.0)
"""Seconds that parents get to arrive after they are published again: at first, and at most; it doubles each time."""


class GenerationLoop:
    """Carries out one generation after the other.

    A node's answer depends only on the request and on what was committed before. So a request to a node that dies is
    repeated after its restart, and the result is the same.

    Args:
        run_id: Id of the run.
        shape: Layers of the controllers.
        descriptor_dim: Number of descriptor dimensions.
        clients: Services of the other nodes.
        pool: Evaluators.
        critics: Client of the critic trainer.
        waiter: Waits for the other nodes.
        imported: (n, P) float32 controllers that the run starts with instead of random ones.
    """

    def __init__(
        self,
        run_id: str,
        shape: MlpShape,
        descriptor_dim: int,
        clients: LoopClients,
        pool: EvaluatorPool,
        critics: TrainerClient,
        waiter: Waiter,
        imported: Float32Array,
    ) -> None:
        self._run_id = run_id
        self._shape = shape
        self._descriptor_dim = descriptor_dim
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
            Metrics of the archive after the generation.
        """
        plan = GenerationPlan.of(settings, before, t, len(self._imported))
        count = self._shape.parameter_count
        batch = Batch.empty(t, plan.evaluations, count, self._descriptor_dim)
        self._pool.begin(t, plan.exploration)
        if plan.training and not self._critics.has(plan.training):
            self._critics.start(plan.training)  # no effect if it is running
        if plan.training and plan.meanwhile:
            self._critics.start_after(plan.meanwhile, plan.training)
        for slots in plan.unlearned:  # evaluated while the critics still train
            self._fill(plan, batch, slots)
        if plan.training:
            self._critics.wait_for(plan.training)
        if plan.meanwhile:
            self._critics.start(plan.meanwhile)  # no effect if it has followed
        for slots in plan.learned:
            self._fill(plan, batch, slots)
        self._waiter.until(lambda: self._pool.done(batch.evaluations))
        self._critics.store(t, batch.evaluations)
        if plan.meanwhile and plan.meanwhile_ends_within:
            self._critics.wait_for(plan.meanwhile)
        return self._add(plan, batch)

    def _fill(self, plan: GenerationPlan, batch: Batch, slots: Slots) -> None:
        """Have offspring made and send each piece to the evaluators at once."""
        if slots.operator == Operator.EXTRACTED:
            self._extract(plan, batch, slots)
            return
        end = slots.first + slots.count
        for first in range(slots.first, end, PIECE):
            places = slice(first, min(first + PIECE, end))
            ids = batch.evaluations[places]
            batch.operators[places] = slots.operator
            if slots.operator == Operator.GREEDY:
                batch.parameters[places] = self._critics.greedy(plan.generation)
            elif slots.operator == Operator.IMPORTED:
                batch.parameters[places] = self._imported[ids]
            else:
                each = OPERATORS[slots.operator].parents
                request = self._proposal(plan, slots.operator, first, len(ids))
                if each:
                    batch.parents[places, :each] = self._sample(request, each)
                    request.parents = flat(batch.parents[places, :each], "q")
                made, aims = self._propose(plan, request, each)
                batch.parameters[places], batch.intended[places] = made, aims
            self._pool.submit(ids, batch.parameters[places], batch.intended[places])

    def _extract(self, plan: GenerationPlan, batch: Batch, slots: Slots) -> None:
        """Have solutions of the archive evaluated again."""
        places = slice(slots.first, slots.first + slots.count)
        request = Extract.Request(run_id=self._run_id, generation=plan.generation)
        response = accepted(self._waiter, self._clients.extract, request)
        size = (slots.count, self._shape.parameter_count)
        batch.operators[places] = slots.operator
        batch.parents[places, 0] = shaped(
            response.evaluations, (slots.count,), np.int64, "evaluations"
        )
        batch.parameters[places] = shaped(response.parameters, size, np.float32, "parameters")
        self._pool.submit(batch.evaluations[places], batch.parameters[places])

    def _sample(self, proposal: Propose.Request, each: int, *, publish: bool = False) -> Int64Array:
        """Return the evaluation ids (n, each) of parents for a proposal."""
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
        self, plan: GenerationPlan, operator: Operator, first: int, n: int
    ) -> Propose.Request:
        request = Propose.Request(
            run_id=self._run_id,
            generation=plan.generation,
            operator_id=int(operator),
            first=first,
            count=n,
        )
        request.rates = rates_to_msg(plan.settings)
        return request

    def _propose(
        self, plan: GenerationPlan, request: Propose.Request, each: int
    ) -> tuple[Float32Array, Float64Array | float]:
        """Return the parameters (n, P) of offspring, and their intended descriptors (n, d), NaN for none."""
        pause, longest = ON_THE_WAY
        while True:
            response = call(self._waiter, self._clients.propose, request)
            if response.accepted:
                size = (request.count, self._shape.parameter_count)
                made = shaped(response.parameters, size, np.float32, "parameters")
                name, aims = "intended_descriptors", response.intended_descriptors
                if not len(aims):
                    return made, np.nan
                size = (request.count, self._descriptor_dim)
                return made, finite(shaped(aims, size, np.float64, name), name)
            if response.lacking:  # a variation node that was restarted, or is about to hear them
                self._sample(request, each, publish=True)
                self._waiter.pause(pause)
                pause = min(2.0 * pause, longest)
            elif response.again and plan.training:
                self._critics.remind(plan.training)
            else:
                raise PgaError(f"The variation node refused: {response.message}")

    def _add(self, plan: GenerationPlan, batch: Batch) -> Metrics:
        """Commit the generation to the archive."""
        solutions = batch.solutions(self._pool.outcomes(batch.evaluations))
        request = AddToArchive.Request(run_id=self._run_id, generation=batch.generation)
        request.operators = solutions.operators.tolist()
        request.parents = flat(solutions.parents, "q")
        request.fitness = flat(solutions.fitness, "d")
        request.descriptors = flat(solutions.descriptors, "d")
        request.steps = flat(solutions.steps, "q")
        request.terminated = solutions.terminated.tolist()
        request.parameters = flat(solutions.parameters, "f")
        request.rates = rates_to_msg(plan.settings)
        return accepted(self._waiter, self._clients.add_to_archive, request).metrics
