"""What the evaluator pool keeps book of: results, chunks of work, and who does them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.client import Client


@dataclass(frozen=True)
class Outcome:
    """Result of one evaluation.

    Attributes:
        fitness: Sum of the rewards.
        descriptor: (descriptor_dim,) float64.
        steps: Length of the episode [control steps].
        terminated: Whether it ended by a fall.
    """

    fitness: float
    descriptor: NDArray[np.float64]
    steps: int
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
        seen: Time of its last sign of life.
        done: Evaluations that it had finished by then.
        progress: Time at which that number last grew.
        refusals: How often in a row it refused what it was asked for.
        chunks: What it was asked for and has not answered.
    """

    client: Client
    process: tuple[str, int]
    usable: float
    seen: float
    done: int
    progress: float
    refusals: int = 0
    chunks: list[Chunk] = field(default_factory=list)


@dataclass(frozen=True)
class Job:
    """What all evaluations of a run have in common."""

    run_id: str
    task: str
    seed: int
    layer_sizes: tuple[int, ...]
    descriptor_dim: int
    versions: str
