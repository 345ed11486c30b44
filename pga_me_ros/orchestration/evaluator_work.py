"""What the evaluator pool keeps book of: results, chunks of work, and who does them."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil
from typing import Any

from rclpy.client import Client

from pga_me_ros.arrays import Float64Array

LOST = 10.0
"""Seconds without a finished evaluation after which a request to a living evaluator first counts as lost on the way."""

STRAGGLER = 3.0
"""How many times the expected time a chunk may take before idle evaluators do it too."""

WORTHWHILE = 0.12
"""Seconds between a request and its answer that make it worth sending: each costs its two ends some ms."""


@dataclass(frozen=True)
class Outcome:
    """Result of one evaluation.

    Attributes:
        fitness: Sum of the rewards.
        descriptor: (descriptor_dim,) float64.
        length: Length of the episode [control steps].
        terminated: Whether it ended by a fall.
    """

    fitness: float
    descriptor: Float64Array
    length: int
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
        seen: Time of its last heartbeat.
        done: Evaluations that it had finished by then.
        progress: Time at which that number last grew.
        refusals: How often in a row it refused what it was asked for.
        given_up: How often in a row requests to it were taken for lost.
        chunks: What it was asked for and has not answered.
    """

    client: Client
    process: tuple[str, int]
    usable: float
    seen: float
    done: int
    progress: float
    refusals: int = 0
    given_up: int = 0
    chunks: list[Chunk] = field(default_factory=list)

    def overdue(self, now: float, seconds: float) -> list[Chunk]:
        """Return the chunks that must have been lost on the way.

        Patience doubles each time: where one episode takes longer, an evaluator must not drown in repeated requests.

        Args:
            now: Time on the monotonic clock.
            seconds: Mean time per evaluation, 0 while unknown.
        """
        patience = max(LOST * 2**self.given_up, 20.0 * seconds)
        return [c for c in self.chunks if now - max(c.sent, self.progress) > patience]

    def late(self, now: float, seconds: float) -> list[int]:
        """Return the evaluations of chunks that take far longer than expected; arguments as in `overdue`."""
        return [
            k
            for chunk in self.chunks
            if now - chunk.sent > 1.0 + STRAGGLER * seconds * len(chunk.ids)
            for k in chunk.ids
        ]


@dataclass(frozen=True)
class Job:
    """What all evaluations of a run have in common."""

    run_id: str
    task: str
    seed: int
    layer_sizes: tuple[int, ...]
    descriptor_dim: int
    versions: str


def share(queued: int, evaluators: int, seconds: float) -> int:
    """Return how many evaluations to ask one evaluator for at once.

    Towards the end they get fewer, so that all finish together, but not so few that asking costs as much as doing.

    Args:
        queued: Evaluations that nobody was asked for yet, at least 1.
        evaluators: Those that share them, at least 1.
        seconds: Mean time per evaluation between request and answer, 0 while unknown.
    """
    worthwhile = ceil(WORTHWHILE / seconds) if seconds else 1
    fair = ceil(queued / evaluators)
    return max(queued // (2 * evaluators), min(worthwhile, fair))
