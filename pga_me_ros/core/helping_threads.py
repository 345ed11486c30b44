"""Threads that help with a piece of work while there are cores for them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from pga_me_ros.core.spare_cores import spare_cores

GoesOn = Callable[[], bool]
"""What a thread asks after each part of the work: whether it is to take another one."""


def do_with_helpers(work: Callable[[GoesOn], None], helpers: int) -> None:
    """Do work in this thread, and in others beside it that come and go as cores are free or wanted by others.

    Args:
        work: Called by each thread. It takes part after part from where all threads take theirs, until none is left or
            it is told not to go on.
        helpers: Other threads at most.
    """
    if helpers < 1:
        work(lambda: True)
        return
    called: list[Future[None]] = []
    with ThreadPoolExecutor(helpers) as pool:

        def call_helpers() -> bool:
            at_work = sum(not helper.done() for helper in called)
            for _ in range(min(spare_cores(), helpers - at_work)):
                called.append(pool.submit(work, lambda: spare_cores() >= 0))
            return True

        call_helpers()
        work(call_helpers)
    for helper in called:
        helper.result()
