"""The evaluators that are there right now, and the evaluations that are to be done by them."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pga_me_msgs.msg import NodeStatus
from pga_me_msgs.srv import Evaluate
from rclpy.client import Client
from rclpy.node import Node

from pga_me_ros.core.errors import PgaError
from pga_me_ros.ros.convert import evaluated_from_msg, flat

SILENCE = 5.0
"""Seconds without a sign of life after which an evaluator's work is given to others."""

IN_FLIGHT = 2
"""Chunks per evaluator at a time: the next one is there when it finishes one, so that no round trip is waited for."""

SETTLE = 1.0
"""Seconds that a restarted evaluator gets until everybody has discovered its new service."""

LOST = 10.0
"""Seconds without a finished evaluation after which a request to a living evaluator counts as lost on the way."""

STRAGGLER = 3.0
"""How many times the expected time a chunk may take before idle evaluators do it too."""

REFUSALS = 3
"""Refusals of a chunk after which the run gives up."""


@dataclass(frozen=True)
class Outcome:
    """Result of one evaluation.

    Attributes:
        fitness: Sum of the rewards.
        descriptor: (descriptor_dim,) float64.
        steps: Length of the episode [control steps].
        terminated: Whether it ended by a fall.
    """

    fitness: float
    descriptor: NDArray[np.float64]
    steps: int
    terminated: bool


@dataclass(eq=False)
class Chunk:
    """Evaluations that one evaluator was asked for in one request."""

    ids: list[int]
    sent: float
    future: Any = None


@dataclass(eq=False)
class Worker:
    """One incarnation of an evaluator.

    Attributes:
        client: Client of its service.
        process: Host and process id.
        usable: Time from which on it may be asked.
        seen: Time of its last sign of life.
        done: Evaluations that it had finished by then.
        progress: Time at which that number last grew.
        chunks: What it was asked for and has not answered.
    """

    client: Client
    process: tuple[str, int]
    usable: float
    seen: float
    done: int
    progress: float
    chunks: list[Chunk] = field(default_factory=list)


@dataclass(frozen=True)
class Job:
    """What all evaluations of a run have in common."""

    run_id: str
    task: str
    seed: int
    layer_sizes: tuple[int, ...]
    descriptor_dim: int
    versions: str


class EvaluatorPool:
    """Spreads evaluations over the evaluators of the run's task, however many there are.

    Results don't depend on who did what: evaluation k starts from the pose of (seed, k). So work is given twice without
    harm when an evaluator is lost or slow, and the first result counts.

    Args:
        node: The orchestrator's node; its executor must spin in another thread.
        job: The run.
        wake: Called, from that thread, whenever a result came in.
    """

    def __init__(self, node: Node, job: Job, wake: Callable[[], None]) -> None:
        self._node = node
        self._job = job
        self._wake = wake
        self._lock = threading.RLock()
        self._workers: dict[str, Worker] = {}
        self._clients: dict[str, Client] = {}
        self._foreign: set[str] = set()
        self._queue: deque[int] = deque()
        self._parameters: dict[int, NDArray[np.float32]] = {}
        self._outcomes: dict[int, Outcome] = {}
        self._refusals = 0
        self._seconds = 0.0  # mean time per evaluation in a chunk, 0 while unknown
        self.generation = 0
        self.error: PgaError | None = None

    def __len__(self) -> int:
        """Return the number of evaluators at work."""
        return len(self._workers)

    def begin(self, generation: int) -> None:
        """Forget the last generation's work and results."""
        with self._lock:
            self.generation = generation
            self._queue.clear()
            self._parameters.clear()
            self._outcomes.clear()

    def submit(self, ids: Sequence[int], parameters: NDArray[np.float32]) -> None:
        """Ask for evaluations.

        Args:
            ids: n evaluation ids.
            parameters: (n, P) float32 parameters.
        """
        with self._lock:
            self._parameters.update(zip(ids, parameters, strict=True))
            self._queue.extend(ids)
            self._dispatch()

    def repeat(self, ids: Sequence[int]) -> None:
        """Do evaluations of this generation again, because their experience was lost."""
        with self._lock:
            for k in ids:
                self._outcomes.pop(k, None)
            self._queue.extend(ids)
            self._dispatch()

    def done(self, ids: Sequence[int]) -> bool:
        """Whether all these evaluations have a result."""
        with self._lock:
            return all(k in self._outcomes for k in ids)

    def outcomes(self, ids: Sequence[int]) -> list[Outcome]:
        """Return the results of finished evaluations."""
        with self._lock:
            return [self._outcomes[k] for k in ids]

    def heard(self, msg: NodeStatus) -> None:
        """Take an evaluator's sign of life: it joins, or stays, or is told apart as of no use."""
        if msg.kind != "evaluator":
            return
        with self._lock:
            now = time.monotonic()
            worker = self._workers.get(msg.node)
            if worker is None or worker.process != (msg.host, msg.pid):
                self._join(msg, now)
            else:
                worker.seen = now
                if msg.done != worker.done:
                    worker.done, worker.progress = msg.done, now

    def lost(self, name: str) -> None:
        """Give the work of an evaluator that is known to be dead to the others."""
        with self._lock:
            worker = self._workers.pop(name, None)
            if worker:
                self._requeue(worker, list(worker.chunks))

    def tick(self) -> None:
        """Look after lost evaluators and requests, and hand out work; call it several times a second."""
        with self._lock:
            now = time.monotonic()
            for name, worker in list(self._workers.items()):
                if now - worker.seen > SILENCE:
                    self._node.get_logger().warning(
                        f"evaluator {name} has been silent for {SILENCE:.0f} s; its work goes to others"
                    )
                    self.lost(name)
                patience = max(LOST, 20.0 * self._seconds)
                late = [c for c in worker.chunks if now - max(c.sent, worker.progress) > patience]
                self._requeue(worker, late)
            self._dispatch()

    def _join(self, msg: NodeStatus, now: float) -> None:
        if not self._fits(msg):
            return
        known = msg.node in self._clients
        self.lost(msg.node)
        if not known:
            # Clients are kept for good: destroying one while the executor waits for it is an error in rclpy.
            self._clients[msg.node] = self._node.create_client(Evaluate, f"{msg.node}/evaluate")
        self._workers[msg.node] = Worker(
            client=self._clients[msg.node],
            process=(msg.host, msg.pid),
            usable=now + (SETTLE if known else 0.0),
            seen=now,
            done=msg.done,
            progress=now,
        )

    def _fits(self, msg: NodeStatus) -> bool:
        job = self._job
        if (msg.task, msg.versions) == (job.task, job.versions):
            return True
        if msg.node not in self._foreign:
            self._foreign.add(msg.node)
            self._node.get_logger().warning(
                f"evaluator {msg.node} is not used: it has task '{msg.task}' with {msg.versions}, "
                f"this run needs '{job.task}' with {job.versions} to give the same results."
            )
        return False

    def _requeue(self, worker: Worker, chunks: Sequence[Chunk]) -> None:
        for chunk in chunks:
            worker.chunks.remove(chunk)
            worker.client.remove_pending_request(chunk.future)
            self._put_back(chunk)

    def _put_back(self, chunk: Chunk) -> None:
        waiting = set(self._queue)
        ids = [k for k in chunk.ids if k in self._parameters and k not in waiting]
        self._queue.extendleft(k for k in reversed(ids) if k not in self._outcomes)

    def _dispatch(self) -> None:
        """Give queued work to evaluators with room; shares shrink towards the end, so that all finish together."""
        now = time.monotonic()
        ready = [
            w for w in self._workers.values() if w.usable <= now and w.client.service_is_ready()
        ]
        for load in range(IN_FLIGHT):
            for worker in ready:
                if self._queue and len(worker.chunks) == load:
                    share = max(1, len(self._queue) // (2 * len(ready)))
                    self._send(worker, [self._queue.popleft() for _ in range(share)])
        if not self._queue:
            self._help_stragglers(now, [w for w in ready if not w.chunks])

    def _help_stragglers(self, now: float, idle: Sequence[Worker]) -> None:
        for helper in idle:
            late = [
                k
                for worker in self._workers.values()
                for chunk in worker.chunks
                for k in chunk.ids
                if now - chunk.sent > 1.0 + STRAGGLER * self._seconds * len(chunk.ids)
                and k in self._parameters  # not of an earlier generation, done twice and forgotten
                and k not in self._outcomes
            ]
            if late and self._seconds:
                self._send(helper, sorted(set(late)))

    def _send(self, worker: Worker, ids: list[int]) -> None:
        job = self._job
        request = Evaluate.Request(
            run_id=job.run_id, task=job.task, seed=job.seed, generation=self.generation
        )
        request.evaluations = flat(ids, "q")
        request.layer_sizes = flat(job.layer_sizes, "q")
        request.parameters = flat(np.stack([self._parameters[k] for k in ids]), "f")
        chunk = Chunk(ids, time.monotonic())
        worker.chunks.append(chunk)
        chunk.future = worker.client.call_async(request)
        chunk.future.add_done_callback(lambda future: self._answered(worker, chunk, future))

    def _answered(self, worker: Worker, chunk: Chunk, future: Any) -> None:
        with self._lock:
            if chunk not in worker.chunks:
                return  # given up meanwhile
            worker.chunks.remove(chunk)
            if all(k in self._parameters for k in chunk.ids):
                self._take(chunk, future.result())
            self._dispatch()
        self._wake()

    def _take(self, chunk: Chunk, response: Evaluate.Response) -> None:
        if not response.accepted:
            self._refuse(chunk, response.message)
            return
        try:
            out = evaluated_from_msg(response, len(chunk.ids), self._job.descriptor_dim)
        except PgaError as error:
            self._refuse(chunk, str(error))
            return
        for i, k in enumerate(chunk.ids):
            outcome = Outcome(
                float(out.fitness[i]),
                out.descriptors[i],
                int(out.steps[i]),
                bool(out.terminated[i]),
            )
            self._outcomes.setdefault(k, outcome)
        took = (time.monotonic() - chunk.sent) / len(chunk.ids)
        self._seconds = took if not self._seconds else 0.9 * self._seconds + 0.1 * took

    def _refuse(self, chunk: Chunk, reason: str) -> None:
        self._refusals += 1
        if self._refusals >= REFUSALS:
            self.error = PgaError(f"Evaluations {chunk.ids} cannot be done: {reason}")
        self._put_back(chunk)
