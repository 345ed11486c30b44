"""A few pieces of work at a time, each on a thread of its own."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import torch

from pga_me_ros.core.spare_cores import spare_cores


class SideBySide:
    """Does pieces of torch work side by side, or one after the other where no core is free, with the same outcome.

    Args:
        workers: Threads at most, that of the caller included.
        torch_threads: Threads of each matrix product; torch keeps that number per thread.
    """

    def __init__(self, workers: int, torch_threads: int) -> None:
        """Prepare the threads; they start with the first work."""

        def prepare() -> None:
            torch.set_num_threads(torch_threads)
            torch.set_grad_enabled(False)

        self._pool = ThreadPoolExecutor(workers - 1, initializer=prepare) if workers > 1 else None

    def __call__(self, *works: Callable[[], None]) -> None:
        """Do all works, which must not touch what another one writes, and wait for their end.

        A work may wait for something that one before it does. The last is done by the caller: a KeyboardInterrupt
        reaches the main thread only, and nobody is left waiting for it.
        """
        if self._pool is None or spare_cores() < 1:
            for work in works:
                work()
            return
        others = [self._pool.submit(work) for work in works[:-1]]
        works[-1]()
        for other in others:
            other.result()
