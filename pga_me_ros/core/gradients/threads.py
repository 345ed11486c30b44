"""Threads that share a gradient computation while cores are idle; no result depends on whether they do.

Two forms of sharing: `PairOfThreads` for two networks that are trained side by side and meet often, and
`run_with_helpers` for many independent parts. Both ask `idle_cores` first: a thread without a core of its own would
only slow down what else runs here.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache

import torch

Job = Callable[[], None]

GoesOn = Callable[[], bool]
"""What a thread asks after each part of the work: whether it should take another one."""


class PairOfThreads:
    """Runs torch jobs in two threads while a core is idle, otherwise one after the other, with the same outcome.

    Args:
        workers: Threads: 2, or 1 for the caller's alone.
        torch_threads: Threads of each matrix product; torch keeps that number per thread.
    """

    def __init__(self, workers: int, torch_threads: int) -> None:
        """Prepare the second thread; it starts with its first job."""

        def prepare() -> None:
            torch.set_num_threads(torch_threads)
            torch.set_grad_enabled(False)

        self._pool = ThreadPoolExecutor(1, initializer=prepare) if workers > 1 else None

    def __call__(self, *jobs: Job) -> None:
        """Run all jobs and wait until they have ended; none may touch what another one writes.

        A job may wait for something that an earlier one does. The caller runs the last one: a KeyboardInterrupt reaches
        the main thread only, and the second thread never waits for it.

        Raises:
            Exception: A job raised it; no job runs any longer then.
        """
        if self._pool is None or idle_cores() < 1:
            for job in jobs:
                job()
            return
        others = self._pool.submit(_run_all, jobs[:-1])
        try:
            jobs[-1]()
        finally:
            wait([others])
        others.result()


def _run_all(jobs: tuple[Job, ...]) -> None:
    for job in jobs:
        job()


def run_with_helpers(work: Callable[[GoesOn], None], helpers: int) -> None:
    """Do work in this thread and in helper threads, which join while cores are idle and leave when others need them.

    Args:
        work: Called by each thread. It takes part after part from where all threads take theirs, until none is left or
            it is told not to go on.
        helpers: Greatest number of other threads.

    Raises:
        Exception: `work` raised it in one of the threads; none runs any longer then.
    """
    if helpers < 1:
        work(lambda: True)
        return
    started: list[Future[None]] = []
    with ThreadPoolExecutor(helpers) as pool:

        def start_helpers() -> bool:
            busy = sum(not helper.done() for helper in started)
            for _ in range(min(idle_cores(), helpers - busy)):
                started.append(pool.submit(work, lambda: idle_cores() >= 0))
            return True

        start_helpers()
        work(start_helpers)
    for helper in started:
        helper.result()


LOAD_FILE = "/proc/loadavg"
"""Where Linux tells how many threads run or could run, whoever owns them."""


def idle_cores() -> int:
    """Return the number of cores that nobody uses right now.

    The caller's core is in use. A negative number says how many threads wait for a core. Where the system doesn't tell,
    the caller is taken to be alone.
    """
    cores = os.cpu_count() or 1
    load = _open_load()
    if load is None:
        return cores - 1
    # As in "0.92 2.17 2.31 3/179 17945": three threads run or could run, the reader among them.
    running = os.pread(load, 100, 0).split()[3].split(b"/")[0]
    return cores - int(running)


@cache
def _open_load() -> int | None:
    """Return a file descriptor that is kept open: a reading then takes 2 µs."""
    try:
        return os.open(LOAD_FILE, os.O_RDONLY)
    except OSError:
        return None
