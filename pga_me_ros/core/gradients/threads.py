"""Threads that share a gradient computation while cores are idle; no result depends on whether they do.

There are two ways to share: `PairOfThreads` for two networks that are trained in parallel and synchronize often, and
`run_with_helpers` for many independent parts. Both check `idle_cores` first: a thread without its own core would only
slow down other processes.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache

import torch

Job = Callable[[], None]

GoesOn = Callable[[], bool]
"""Returns whether a thread should take another part of the work; called after each part."""


class PairOfThreads:
    """Runs torch jobs in two threads while a core is idle, otherwise one after the other, with the same outcome.

    Args:
        workers: Number of threads: 2, or 1 for the caller only.
        torch_threads: Threads of each matrix product; torch keeps that number per thread.
    """

    def __init__(self, workers: int, torch_threads: int) -> None:
        """Prepare the second thread; it starts with its first job."""

        def prepare() -> None:
            torch.set_num_threads(torch_threads)
            torch.set_grad_enabled(False)

        self._pool = ThreadPoolExecutor(1, initializer=prepare) if workers > 1 else None

    def __call__(self, *jobs: Job) -> None:
        """Run all jobs and wait until they have ended; no job may access what another one writes.

        A job may wait for an earlier one. The caller runs the last one: a KeyboardInterrupt reaches only the main
        thread, and the second thread never waits for it.

        Raises:
            Exception: A job raised it; all jobs have ended.
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
        work: Called by each thread. It takes part after part from a source shared by all threads, until none is left
            or it is told to stop.
        helpers: Maximum number of helper threads.

    Raises:
        Exception: `work` raised it in one of the threads; all have ended.
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
"""Where Linux reports how many threads of all users run or could run."""


def idle_cores() -> int:
    """Return the number of cores that are idle now.

    The caller's core is in use. A negative number means that this many threads wait for a core. If the system does not
    tell, the caller is assumed to be alone.
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
    """Return a file descriptor that stays open, so that a reading takes 2 µs."""
    try:
        return os.open(LOAD_FILE, os.O_RDONLY)
    except OSError:
        return None
