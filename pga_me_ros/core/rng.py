"""Random generators that depend on their purpose, never on what ran before.

Every draw of a run comes from a generator that is a pure function of (seed, purpose, generation, index), so that
neither the order in which processes work nor restarts can change a single bit of the result.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Purpose(IntEnum):
    """What a generator is used for. Values are part of the stored result: never renumber."""

    CENTROIDS = 1
    RANDOM_CONTROLLER = 2
    EVALUATION = 3
    PARENTS = 4
    GA_VARIATION = 5
    PG_BATCHES = 6
    CRITIC_INIT = 7
    CRITIC_TRAINING = 8
    REEVALUATION = 9
    EXPLORATION = 10
    ES_NOISE = 11
    ES_SELECTION = 12
    QDRL_SELECTION = 13
    DIVERSITY_TRAINING = 14
    EXTRACTION = 15


def generator(
    seed: int, purpose: Purpose, generation: int = 0, index: int = 0
) -> np.random.Generator:
    """Return the PCG64 generator of (seed, purpose, generation, index).

    Args:
        seed: Seed of the run, at least 0.
        purpose: Purpose of the draws.
        generation: Generation they belong to, 0 if there is none.
        index: Number of the solution, step or batch within it.

    Returns:
        A fresh generator; equal arguments give equal streams.
    """
    sequence = np.random.SeedSequence(entropy=seed, spawn_key=(int(purpose), generation, index))
    return np.random.Generator(np.random.PCG64(sequence))
