"""Worker processes that re-evaluate elites."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from itertools import islice
from multiprocessing.process import BaseProcess

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.evaluation import reevaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import MlpShape
from pga_me_ros.core.storage.reevaluations import RepeatOutcome
from pga_me_ros.errors import PgaError
from pga_me_ros.tasks.protocol import Task
from pga_me_ros.tasks.registry import make_task
from pga_me_ros.tasks.rollout import rollout

THREADS = "OPENBLAS_NUM_THREADS"
"""Set to 1, as for evaluators: synchronizing threads costs more than such small matrix products."""


@dataclass(frozen=True)
class Job:
    """Repeats of one elite.

    Attributes:
        evaluation: Evaluation id of the elite.
        repeats: Numbers of the repeats.
        parameters: (P,) float32 parameters of its controller.
    """

    evaluation: int
    repeats: tuple[int, ...]
    parameters: Float32Array


@dataclass(frozen=True)
class SimulatedWorld:
    """The task that controllers are simulated in.

    Attributes:
        task: Task, as for `make_task`.
        randomization: What varies from episode to episode, empty for nothing.
    """

    task: str
    randomization: str = ""


class Evaluator:
    """A worker's simulator, kept from job to job.

    Args:
        world: Task to simulate.
        shape: Layers of the controllers.
        seed: Seed of the run.
    """

    def __init__(self, world: SimulatedWorld, shape: MlpShape, seed: int) -> None:
        self._shape = shape
        self._seed = seed
        self._task: Task = make_task(world.task, world.randomization)

    def evaluate(self, job: Job) -> list[RepeatOutcome]:
        """Carry out a job."""
        controller = MlpController(self._shape, job.parameters)
        outcomes = []
        for repeat in job.repeats:
            e = rollout(self._task, controller, reevaluation_rng(self._seed, repeat))
            outcomes.append(
                RepeatOutcome(
                    job.evaluation, repeat, e.fitness, e.descriptor, e.length, e.terminated
                )
            )
        return outcomes


_evaluator: Evaluator | None = None


def _begin() -> None:
    """Prepare a process of the pool."""
    parent = multiprocessing.parent_process()
    if parent is not None:  # killed, it could not end the pool, and no process of it would notice
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the parent stops the pool


def _end_with(parent: BaseProcess) -> None:
    """End this process as soon as its parent is gone."""
    parent.join()
    os._exit(1)


def _evaluate(job: Job, world: SimulatedWorld, shape: MlpShape, seed: int) -> list[RepeatOutcome]:
    # Made in the first job, not in _begin, so that a task's error reaches the parent.
    global _evaluator
    if _evaluator is None:
        _evaluator = Evaluator(world, shape, seed)
    return _evaluator.evaluate(job)


def evaluated(
    jobs: Sequence[Job], world: SimulatedWorld, shape: MlpShape, seed: int, processes: int
) -> Generator[list[RepeatOutcome], None, None]:
    """Carry out jobs in several processes; yields the outcomes of each as soon as it is done.

    The outcomes do not depend on the number of processes.

    Args:
        jobs: Jobs to do.
        world: Task to simulate.
        shape: Layers of the controllers.
        seed: Seed of the run.
        processes: Number of processes, at least 1.

    Raises:
        TaskError: The task does not start or breaks its protocol.
        PgaError: A process was killed.
    """
    with _setting(THREADS, "1"):
        pool = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _begin)
        calls = (partial(_evaluate, job, world, shape, seed) for job in jobs)
        try:
            yield from _results(pool, calls, 2 * processes)
        except BrokenProcessPool:
            raise PgaError(
                "A worker process was killed, perhaps for lack of memory; run the command again with fewer "
                "--processes. The outcomes so far are kept."
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)


def _results(
    pool: ProcessPoolExecutor, calls: Iterator[Callable[[], list[RepeatOutcome]]], ahead: int
) -> Iterator[list[RepeatOutcome]]:
    """Yield results with at most `ahead` pending calls; more would only take memory."""
    running: set[Future[list[RepeatOutcome]]] = {pool.submit(call) for call in islice(calls, ahead)}
    while running:
        done, running = wait(running, return_when=FIRST_COMPLETED)
        running |= {pool.submit(call) for call in islice(calls, len(done))}
        for future in done:
            yield future.result()


@contextlib.contextmanager
def _setting(name: str, value: str) -> Iterator[None]:
    """Set an environment variable for child processes to inherit."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before
