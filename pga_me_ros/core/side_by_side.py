"""A few pieces of work at a time, each on a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import torch

from pga_me_ros.core.event_count import EventCount
from pga_me_ros.core.spare_cores import spare_cores

Work = Callable[[], None]


class SideBySide:
    """Does pieces of torch work side by side, or one after the other where no core is free, with the same outcome.

    Args:
        workers: Threads: 2, or 1 for that of the caller alone.
        torch_threads: Threads of each matrix product; torch keeps that number per thread.
    """

    def __init__(self, workers: int, torch_threads: int) -> None:
        """Prepare the helper; it starts with the first work."""

        def prepare() -> None:
            torch.set_num_threads(torch_threads)
            torch.set_grad_enabled(False)

        self._pool = ThreadPoolExecutor(1, initializer=prepare) if workers > 1 else None
        self._lock = threading.Lock()
        self._looking = False
        self._works: Sequence[Work] = ()
        self._fault: BaseException | None = None
        self._given, self._done = EventCount(), EventCount()

    def __call__(self, *works: Work) -> None:
        """Do all works, which must not touch what another one writes, and wait for their end.

        A work may wait for something that one before it does. The last is done by the caller: a KeyboardInterrupt
        reaches the main thread only, and the helper never waits for it.
        """
        # A helper that looks for work uses a core, which is there for this work.
        if self._pool is None or spare_cores() + self._looking < 1:
            for work in works:
                work()
            return
        self._give(self._pool, works[:-1])
        try:
            works[-1]()
        finally:
            self._done.wait_for(self._given.count)
            fault, self._fault = self._fault, None
        if fault is not None:
            raise fault

    def _give(self, pool: ThreadPoolExecutor, works: Sequence[Work]) -> None:
        self._works = works
        with self._lock:
            self._given.advance()
            if not self._looking:
                pool.submit(self._help)

    def _help(self) -> None:
        """Do what was given, and what is given next if that comes soon."""
        number = self._given.count
        while True:
            try:
                for work in self._works:
                    work()
            except BaseException as error:
                self._fault = error
            self._works = ()
            self._looking = True
            self._done.advance()
            number += 1
            self._given.look_for(number)
            with self._lock:
                self._looking = False
                if self._given.count < number:
                    return
