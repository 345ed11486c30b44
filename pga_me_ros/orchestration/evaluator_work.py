"""The evaluator pool's records: results, chunks of work, and evaluators."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import repeat
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from pga_me_msgs.srv import Evaluate
from rclpy.client import Client

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.exploration import Noise
from pga_me_ros.errors import PgaError
from pga_me_ros.ros.convert import flat
from pga_me_ros.ros.evaluations import aims_to_msg, evaluated_from_msg

LOST = 10.0
"""Seconds without a finished evaluation after which a request to a living evaluator first counts as lost."""

STRAGGLER = 3.0
"""Multiple of the expected time that a chunk may take before idle evaluators do it, too."""

WORTHWHILE = 0.12
"""Seconds of work that make a request worth sending: each costs both ends a few ms."""


FIRST = -1
"""In place of a repeat's number: the evaluation itself, from which a run learns."""


class Controller(NamedTuple):
    """What is to be evaluated.

    Attributes:
        parameters: (P,) float32.
        intended: (descriptor_dim,) float64 descriptor that it is meant to achieve, NaN for none in particular; None for
            none in the whole request.
        evaluation: Evaluation id.
        repeat: Number of the re-evaluation, `FIRST` for the evaluation itself.
    """

    parameters: Float32Array
    intended: Float64Array | None
    evaluation: int
    repeat: int = FIRST


def controllers_of(
    ids: Sequence[int],
    parameters: Iterable[Float32Array],
    intended: Float64Array | None,
    again: Sequence[tuple[int, int]],
) -> dict[int, Controller]:
    """Return what is to be evaluated by id; arguments as in `EvaluatorPool.submit`."""
    aims = repeat(None) if intended is None else iter(intended)
    work = again or [(k, FIRST) for k in ids]
    rows = zip(ids, parameters, aims, work, strict=False)
    return {k: Controller(vector, aim, *of) for k, vector, aim, of in rows}


@dataclass(frozen=True)
class Outcome:
    """Result of one evaluation.

    Attributes:
        fitness: Sum of the rewards.
        descriptor: (descriptor_dim,) float64.
        length: Length of the episode [control steps].
        terminated: Whether the episode ended in a fall.
    """

    fitness: float
    descriptor: Float64Array
    length: int
    terminated: bool


@dataclass(eq=False)
class Chunk:
    """The evaluations of one request to an evaluator."""

    ids: list[int]
    sent: float
    future: Any = None


@dataclass(eq=False)
class Worker:
    """One process of an evaluator.

    Attributes:
        client: Client of its service.
        process: Host and process id.
        usable: Time from which it may get requests.
        last_heartbeat: Time of its last heartbeat.
        done: Number of evaluations it had finished by then.
        progress: Time at which that number last grew.
        refusals: Number of refusals in a row.
        given_up: Number of requests in a row that counted as lost.
        chunks: Requests that it has not answered.
    """

    client: Client
    process: tuple[str, int]
    usable: float
    last_heartbeat: float
    done: int
    progress: float
    refusals: int = 0
    given_up: int = 0
    chunks: list[Chunk] = field(default_factory=list)

    def overdue(self, now: float, seconds: float) -> list[Chunk]:
        """Return the chunks that must have been lost.

        The time allowed doubles each time: if an episode takes long, repeated requests must not flood an evaluator.

        Args:
            now: Time on the monotonic clock.
            seconds: Mean time per evaluation, 0 if unknown.
        """
        patience = max(LOST * 2**self.given_up, 20.0 * seconds)
        return [c for c in self.chunks if now - max(c.sent, self.progress) > patience]

    def late(self, now: float, seconds: float) -> list[int]:
        """Return the evaluations of chunks that take far longer than expected; arguments as in `overdue`."""
        return [
            k
            for chunk in self.chunks
            if now - chunk.sent > 1.0 + STRAGGLER * seconds * len(chunk.ids)
            for k in chunk.ids
        ]


@dataclass(frozen=True)
class Job:
    """What all evaluations of a run have in common."""

    run_id: str
    task: str
    seed: int
    layer_sizes: tuple[int, ...]
    descriptor_dim: int
    versions: str
    randomization: str = ""

    def why_not(self, task: str, versions: str) -> str:
        """Return why an evaluator is not fit for this work, empty if it is.

        Args:
            task: Its task.
            versions: The versions that its results depend on, separated by commas.
        """
        if task != self.task:
            return f"it has task '{task}', this run needs '{self.task}'."
        theirs, ours = versions.split(", "), self.versions.split(", ")
        if theirs == ours:
            return ""
        found = ", ".join(v for v in theirs if v not in ours) or "no others"
        needed = ", ".join(v for v in ours if v not in theirs) or "nothing else"
        return (
            f"it has {found}, this run needs {needed} to give the same results; start it in an environment like that "
            "of the run."
        )

    def request(
        self, generation: int, exploration: Noise, controllers: Sequence[Controller]
    ) -> Evaluate.Request:
        """Return what an evaluator is asked for.

        Args:
            generation: Generation of the controllers.
            exploration: Noise on actions.
            controllers: What to evaluate, at least one; all of them re-evaluations or none.
        """
        request = Evaluate.Request(run_id=self.run_id, task=self.task, seed=self.seed)
        request.generation = generation
        request.randomization = self.randomization
        request.exploration_sigma = exploration.sigma
        request.exploration_correlation = exploration.correlation
        request.evaluations = flat([c.evaluation for c in controllers], "q")
        if controllers[0].repeat != FIRST:
            request.repeats = flat([c.repeat for c in controllers], "q")
        request.layer_sizes = flat(self.layer_sizes, "q")
        request.parameters = flat(np.stack([c.parameters for c in controllers]), "f")
        aims = [c.intended for c in controllers if c.intended is not None]
        if aims:
            request.intended_descriptors = aims_to_msg(np.stack(aims))
        return request

    def outcomes(self, response: Evaluate.Response, count: int) -> list[Outcome]:
        """Return the results of a request for so many evaluations, one by one.

        Raises:
            PgaError: The evaluator refused the request, or its answer is malformed.
        """
        if not response.accepted:
            raise PgaError(response.message)
        out = evaluated_from_msg(response, count, self.descriptor_dim)
        columns = (out.fitness, out.descriptors, out.steps, out.terminated)
        return [
            Outcome(float(fitness), descriptor, int(steps), bool(terminated))
            for fitness, descriptor, steps, terminated in zip(*columns, strict=True)
        ]


def share(queued: int, evaluators: int, seconds: float) -> int:
    """Return how many evaluations to send to one evaluator at once.

    Towards the end, chunks shrink so that all evaluators finish together, but a request must stay worth its cost.

    Args:
        queued: Evaluations that no evaluator has yet, at least 1.
        evaluators: Number of evaluators that share them, at least 1.
        seconds: Mean time per evaluation between request and answer, 0 if unknown.
    """
    worthwhile = ceil(WORTHWHILE / seconds) if seconds else 1
    fair = ceil(queued / evaluators)
    return max(queued // (2 * evaluators), min(worthwhile, fair))
