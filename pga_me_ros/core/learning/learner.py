"""What the generation loop needs from a learner, be it critics or an evolution strategy."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Protocol

from numpy.typing import NDArray

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.tasks.rollout import Episode


class Learner(Protocol):
    """Learns from whole generations of experience and returns a `Snapshot` for the next offspring.

    Attributes:
        version: Training steps done since the start of the run.
        newest: Newest generation whose experience it has, -1 for none.
    """

    version: int
    newest: int

    def forget_experience(self) -> None:
        """Forget the experience, but keep what was learned from it."""

    def add(self, generation: int, episodes: Iterable[Episode]) -> None:
        """Take one generation's episodes, in evaluation order."""

    def start_greedy_at(self, parameters: Float32Array) -> None:
        """Start the greedy controller as a copy of a controller (setting ``greedy_init: best``)."""

    def train(self, rates: Settings, generation: int) -> Snapshot:
        """Train, and return what a generation's offspring are made with."""

    def state(self) -> dict[str, NDArray[Any]]:
        """Return what was learned as named arrays that later training does not change."""

    def load_state(self, state: dict[str, NDArray[Any]], version: int) -> None:
        """Continue from a stored state, bit for bit."""
