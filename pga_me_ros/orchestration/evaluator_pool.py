"""The evaluators that are present, and the evaluations they have to do."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from pga_me_msgs.msg import NodeStatus
from pga_me_msgs.srv import Evaluate
from rclpy.client import Client
from rclpy.node import Node

from pga_me_ros.arrays import Float32Array, Float64Array
from pga_me_ros.core.exploration import QUIET, Noise
from pga_me_ros.errors import PgaError
from pga_me_ros.orchestration.evaluator_work import (
    Chunk,
    Controller,
    Job,
    Outcome,
    Worker,
    controllers_of,
    share,
)
from pga_me_ros.orchestration.roster import STALE
from pga_me_ros.ros import qos
from pga_me_ros.ros.namesakes import offers_service
from pga_me_ros.ros.refusals import printable

IN_FLIGHT = 2
"""Chunks per evaluator at a time: the next one is waiting when it finishes one, which hides the round trip."""

SETTLE = 1.0
"""Seconds until every node has discovered the service of a restarted evaluator."""

REFUSALS = 3
"""Refusals in a row after which an evaluator gets no more work; the run fails if no evaluator is left."""

MOST_WARNINGS = 1000
"""Maximum number of unusable evaluators that are reported; further ones are ignored."""

RIVAL = 2.5
"""Seconds after an evaluator's last heartbeat during which another process cannot take its name."""


class EvaluatorPool:
    """Distributes evaluations among the evaluators of the run's task, however many there are.

    Results do not depend on which evaluator did what: evaluation k starts from the pose of (seed, k). So work may be
    given out twice if an evaluator is lost or slow, and the first result counts.

    Args:
        node: The orchestrator's node; its executor must spin in another thread.
        job: The run.
        wake: Called from that thread whenever a result has arrived.
    """

    def __init__(self, node: Node, job: Job, wake: Callable[[], None]) -> None:
        self._node = node
        self._job = job
        self._wake = wake
        self._lock = threading.RLock()
        self._workers: dict[str, Worker] = {}
        self._clients: dict[str, Client] = {}
        self._warned: set[int] = set()
        self._dead: set[tuple[str, int]] = set()
        self._queue: deque[int] = deque()
        self._controllers: dict[int, Controller] = {}
        self._outcomes: dict[int, Outcome] = {}
        self._seconds = 0.0  # mean time per evaluation in a chunk, 0 if unknown
        self.generation = 0
        self._exploration = QUIET
        self._error: PgaError | None = None

    def __len__(self) -> int:
        """Return the number of usable evaluators."""
        return len(self._workers)

    @property
    def waiting(self) -> int:
        """Number of evaluations that were not answered yet; those sent twice count twice."""
        with self._lock:
            sent = sum(len(c.ids) for worker in self._workers.values() for c in worker.chunks)
            return len(self._queue) + sent

    def begin(self, generation: int, exploration: Noise = QUIET) -> None:
        """Forget the last generation's work and results.

        Args:
            generation: The next generation.
            exploration: Noise on the actions of all its episodes.
        """
        with self._lock:
            self.generation = generation
            self._exploration = exploration
            self._queue.clear()
            self._controllers.clear()
            self._outcomes.clear()

    def submit(
        self,
        ids: Sequence[int],
        parameters: Iterable[Float32Array],
        intended: Float64Array | None = None,
        again: Sequence[tuple[int, int]] = (),
    ) -> None:
        """Ask for evaluations.

        Args:
            ids: n evaluation ids; of re-evaluations, n numbers below 0, which no evaluation has.
            parameters: (n, P) float32 parameters.
            intended: (n, descriptor_dim) float64 descriptors that they are meant to achieve, NaN or None for none.
            again: (evaluation id, repeat) of each re-evaluation; empty if these are evaluations.
        """
        with self._lock:
            self._controllers |= controllers_of(ids, parameters, intended, again)
            self._queue.extend(ids)
            self._dispatch()

    def repeat(self, ids: Sequence[int]) -> None:
        """Repeat evaluations of this generation, because their experience was lost."""
        with self._lock:
            for k in ids:
                self._outcomes.pop(k, None)
            self._queue.extend(ids)
            self._dispatch()

    def done(self, ids: Sequence[int]) -> bool:
        """Whether all these evaluations have a result; raises as `finished` does."""
        return len(self.finished(ids)) == len(ids)

    def finished(self, ids: Sequence[int]) -> list[int]:
        """Return which of these evaluations have a result.

        Raises:
            PgaError: All evaluators refuse them.
        """
        with self._lock:
            if self._error:
                raise self._error
            return [k for k in ids if k in self._outcomes]

    def outcomes(self, ids: Sequence[int]) -> list[Outcome]:
        """Return the results of finished evaluations."""
        with self._lock:
            return [self._outcomes[k] for k in ids]

    def heard(self, msg: NodeStatus) -> None:
        """Process an evaluator's heartbeat: it joins, stays, or is reported as unusable."""
        if msg.kind != "evaluator":
            return
        with self._lock:
            now = time.monotonic()
            worker = self._workers.get(msg.node)
            if worker is None:
                self._join(msg, now)
            elif worker.process != (msg.host, msg.pid):
                self._replace(worker, msg, now)
            else:
                worker.last_heartbeat = now
                if msg.done != worker.done:
                    worker.done, worker.progress = msg.done, now

    def died(self, name: str) -> None:
        """Give the work of a dead evaluator to the others."""
        with self._lock:
            if name in self._workers:
                self._dead.add(self._workers[name].process)
                self._lose(name)

    def tick(self) -> None:
        """Deal with lost evaluators and requests, and hand out work; call it several times a second."""
        with self._lock:
            now = time.monotonic()
            for name, worker in list(self._workers.items()):
                if now - worker.last_heartbeat > STALE:
                    if worker.chunks:  # without work it is not missed, as after the end of a run
                        self._node.get_logger().warning(
                            f"evaluator {name} has been silent for {STALE:.0f} s; its work goes to others"
                        )
                    self._lose(name)
                elif worker.chunks and not worker.client.service_is_ready():
                    self._lose(name)  # it has exited; its silence would show only later
                overdue = worker.overdue(now, self._seconds)
                for chunk in overdue:  # a late answer still counts
                    worker.chunks.remove(chunk)
                    self._put_back(chunk)
                worker.given_up += bool(overdue)
            self._dispatch()

    def _lose(self, name: str) -> None:
        worker = self._workers.pop(name)
        for chunk in worker.chunks:
            worker.client.remove_pending_request(chunk.future)
            self._put_back(chunk)

    def _replace(self, worker: Worker, msg: NodeStatus, now: float) -> None:
        """Replace an evaluator by its restarted process, but not by a rival of the same name."""
        if now - worker.last_heartbeat > RIVAL:
            self._lose(msg.node)
            self._join(msg, now)
        else:
            self._warn_once(
                (msg.node, msg.host, msg.pid),
                f"evaluator {msg.node} (process {msg.pid} on {msg.host}) is not used: process "
                f"{worker.process[1]} on {worker.process[0]} has the same name. "
                "Give it another one (--ros-args -r __node:=NAME).",
            )

    def _join(self, msg: NodeStatus, now: float) -> None:
        if (msg.host, msg.pid) in self._dead or not self._fits(msg):
            return
        known = msg.node in self._clients
        if not known:
            if not offers_service(self._node, f"{msg.node}/evaluate"):
                return  # its next heartbeat comes in a second
            # Clients are never destroyed: doing so while the executor waits for one is an error in rclpy.
            self._clients[msg.node] = self._node.create_client(
                Evaluate, f"{msg.node}/evaluate", qos_profile=qos.CLIENT
            )
        self._workers[msg.node] = Worker(
            client=self._clients[msg.node],
            process=(msg.host, msg.pid),
            usable=now + (SETTLE if known else 0.0),
            last_heartbeat=now,
            done=msg.done,
            progress=now,
        )

    def _fits(self, msg: NodeStatus) -> bool:
        reason = self._job.why_not(msg.task, msg.versions)
        if reason:
            who = (msg.node, msg.host, msg.pid)
            self._warn_once(who, f"evaluator {msg.node} is not used: {reason}")
        return not reason

    def _warn_once(self, who: tuple[str, str, int], text: str) -> None:
        key = hash(who)  # a stranger's name may be arbitrarily long
        if key not in self._warned and len(self._warned) < MOST_WARNINGS:
            self._warned.add(key)
            self._node.get_logger().warning(printable(text))

    def _put_back(self, chunk: Chunk) -> None:
        waiting = set(self._queue)
        ids = [k for k in chunk.ids if k in self._controllers and k not in waiting]
        self._queue.extendleft(k for k in reversed(ids) if k not in self._outcomes)

    def _dispatch(self) -> None:
        """Give queued work to evaluators that have room."""
        now = time.monotonic()
        if self._queue:
            ready = self._ready(now)
            for load in range(IN_FLIGHT):
                for worker in ready:
                    if self._queue and len(worker.chunks) == load:
                        n = share(len(self._queue), len(ready), self._seconds)
                        self._send(worker, [self._queue.popleft() for _ in range(n)])
        if not self._queue:
            self._help_stragglers(now)

    def _ready(self, now: float) -> list[Worker]:
        """Return the evaluators whose service is available; rclpy takes a while to check each."""
        return [
            w
            for w in self._workers.values()
            if w.usable <= now and w.refusals < REFUSALS and w.client.service_is_ready()
        ]

    def _help_stragglers(self, now: float) -> None:
        late = {
            k
            for worker in self._workers.values()
            for k in worker.late(now, self._seconds)
            if k in self._controllers  # not of an earlier generation, done twice and forgotten
            and k not in self._outcomes
        }
        if not late or not self._seconds:
            return
        idle = [w for w in self._ready(now) if not w.chunks]
        for i, helper in enumerate(idle):
            some = sorted(late)[i :: len(idle)]
            if some:
                self._send(helper, some)

    def _send(self, worker: Worker, ids: list[int]) -> None:
        what = [self._controllers[k] for k in ids]
        request = self._job.request(self.generation, self._exploration, what)
        worker.chunks.append(chunk := Chunk(ids, time.monotonic()))
        chunk.future = worker.client.call_async(request)
        chunk.future.add_done_callback(lambda future: self._answered(worker, chunk, future))

    def _answered(self, worker: Worker, chunk: Chunk, future: Any) -> None:
        with self._lock:
            if chunk in worker.chunks:  # else it was given up in the meantime
                worker.chunks.remove(chunk)
            if all(k in self._controllers for k in chunk.ids):  # else of an earlier generation
                self._take(worker, chunk, future.result())
            self._dispatch()
            all_done = self._error or len(self._outcomes) == len(self._controllers)
        if all_done:  # callers wait for everything that was submitted
            self._wake()

    def _take(self, worker: Worker, chunk: Chunk, response: Evaluate.Response) -> None:
        try:
            outcomes = self._job.outcomes(response, len(chunk.ids))
        except PgaError as error:
            self._refuse(worker, chunk, str(error))
            return
        worker.refusals = worker.given_up = 0
        for k, outcome in zip(chunk.ids, outcomes, strict=True):
            self._outcomes.setdefault(k, outcome)
        took = (time.monotonic() - chunk.sent) / len(chunk.ids)
        self._seconds = took if not self._seconds else 0.9 * self._seconds + 0.1 * took

    def _refuse(self, worker: Worker, chunk: Chunk, reason: str) -> None:
        worker.refusals += 1
        self._put_back(chunk)
        if worker.refusals == REFUSALS:
            self._node.get_logger().warning(
                f"the evaluator in process {worker.process[1]} on {worker.process[0]} refused "
                f"{REFUSALS} times and gets no more work: {reason}"
            )
        if all(w.refusals >= REFUSALS for w in [worker, *self._workers.values()]):
            self._error = PgaError(f"Evaluations {chunk.ids} cannot be done: {reason}")
