"""The operators, which make the controllers of a batch; one row each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum


class Operator(IntEnum):
    """How a solution was made. Values are part of the stored result: never renumber."""

    RANDOM = 0
    GA = 1
    PG = 2
    GREEDY = 3
    IMPORTED = 4
    ES_SAMPLE = 5
    QUALITY = 6
    DIVERSITY = 7
    EXTRACTED = 8
    ACTOR_INJECTION = 9

    @property
    def label(self) -> str:
        """Its name in messages, files and tables, for example ``pg``."""
        return self.name.lower()


@dataclass(frozen=True)
class OperatorRow:
    """What the generation loop has to know about an operator.

    Attributes:
        title: Name for people.
        parents: Elites that each of its offspring is made from; of an actor injection, the elite whose descriptor the
            actor is asked for.
        learned: Whether its offspring are made with what was learned for their generation, the snapshot.
        learned_from: First generation in which they are.
    """

    title: str
    parents: int = 0
    learned: bool = False
    learned_from: int = 0


OPERATORS: Mapping[Operator, OperatorRow] = {
    Operator.RANDOM: OperatorRow("random"),
    Operator.GA: OperatorRow("GA", parents=2),
    Operator.PG: OperatorRow("PG", parents=1, learned=True),
    Operator.GREEDY: OperatorRow("greedy controller", learned=True),
    Operator.IMPORTED: OperatorRow("imported"),
    Operator.ES_SAMPLE: OperatorRow("ES sample", learned=True, learned_from=1),
    Operator.QUALITY: OperatorRow("quality", parents=1, learned=True),
    Operator.DIVERSITY: OperatorRow("diversity", parents=1, learned=True),
    Operator.EXTRACTED: OperatorRow("evaluated again"),
    Operator.ACTOR_INJECTION: OperatorRow("actor injection", parents=1, learned=True),
}
"""All operators. `core.variation.make_offspring` makes their offspring."""


def needs_snapshot(operator: Operator, generation: int) -> bool:
    """Whether an operator's offspring depend on what was learned for their generation."""
    row = OPERATORS[operator]
    return row.learned and generation >= row.learned_from
