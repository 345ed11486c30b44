"""Threads that wait for each other for fractions of a millisecond."""

import threading

import torch

from pga_me_ros.core.compiled import compiled

LOOKS = 2000
"""Looks at a count before its reader goes to sleep: half a millisecond, about three times what waking it takes."""


@compiled
def _reaches(count: torch.Tensor, number: int, looks: int) -> bool:
    """Look at a count again and again, without keeping other threads from running Python."""
    for _ in range(looks):  # noqa: SIM110 - TorchScript has no generators
        if int(count) >= number:
            return True
    return False


class EventCount:
    """Counts what one thread does, for another one to wait for.

    A thread that sleeps is awake some 0.15 ms after it was woken, and the two threads of a critic training meet some
    300 times a second. So a reader looks at the count for a while before it goes to sleep.
    """

    def __init__(self) -> None:
        """Start at 0."""
        self._tensor = torch.zeros((), dtype=torch.int64)
        self._number = self._tensor.numpy()
        self._asleep = False
        self._woken = threading.Event()

    @property
    def count(self) -> int:
        """What has been counted so far."""
        return int(self._number)

    def advance(self) -> None:
        """Count one more; only one thread at a time may."""
        self._number += 1
        if self._asleep:
            self._woken.set()

    def look_for(self, number: int) -> bool:
        """Say whether the count reaches a number within a moment."""
        return _reaches(self._tensor, number, LOOKS)

    def wait_for(self, number: int) -> None:
        """Wait until the count has reached a number; only one thread at a time may."""
        if self.look_for(number):
            return
        self._asleep = True
        while self.count < number:
            self._woken.wait()
            self._woken.clear()
        self._asleep = False
