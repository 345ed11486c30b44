"""The episodes of a recorded run: each evaluation once, in evaluation order."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from pga_me_msgs.msg import Metrics, Transitions
from rclpy.serialization import deserialize_message

from pga_me_ros.errors import RequestError, StorageError
from pga_me_ros.recording.bag import read_bag
from pga_me_ros.recording.definitions import type_name
from pga_me_ros.recording.gaps import SeenEpisodes
from pga_me_ros.recording.message_heads import EpisodeHead, committed_evaluations, episode_head
from pga_me_ros.ros.convert import episode_from_msg
from pga_me_ros.ros.refusals import printable
from pga_me_ros.tasks.rollout import Episode
from pga_me_ros.tasks.spec import TaskSpec

TRANSITIONS, METRICS = type_name(Transitions), type_name(Metrics)


@dataclass(frozen=True)
class RecordedRun:
    """What a recording contains of one run.

    Attributes:
        bag: The recording.
        run_id: Id of the run.
        task: Name of its task.
        heads: Head of each episode, in evaluation order, each evaluation once.
        repeated: Number of messages beyond the first of each evaluation.
        differing: Evaluations with different episodes; the last one counts.
        missing: Evaluations that should be there but are not, as returned by `SeenEpisodes.missing`.
    """

    bag: Path
    run_id: str
    task: str
    heads: tuple[EpisodeHead, ...]
    repeated: int
    differing: tuple[int, ...]
    missing: tuple[int, ...]

    def newest(self, transitions: int) -> tuple[EpisodeHead, ...]:
        """Return the newest episodes that have at least this many transitions together, or all, in evaluation order."""
        first = len(self.heads)
        while first and transitions > 0:
            first -= 1
            transitions -= self.heads[first].steps
        return self.heads[first:]

    def episodes(
        self, heads: Iterable[EpisodeHead], spec: TaskSpec
    ) -> Iterator[tuple[int, dict[int, Episode]]]:
        """Read episodes.

        Args:
            heads: Heads of the episodes to read, in evaluation order.
            spec: The task.

        Yields:
            Generation and its episodes by evaluation, both ascending.

        Raises:
            StorageError: The recording is damaged, or the episodes do not fit the task.
        """
        chosen = tuple(heads)
        wanted = {head.evaluation for head in chosen}
        found: dict[int, Episode] = {}
        for message in read_bag(self.bag, [TRANSITIONS]):
            head = _head(self.bag, message.data)
            if head.run_id == self.run_id and head.evaluation in wanted:
                found[head.evaluation] = _episode(self.bag, message.data, spec)
        for generation, group in groupby(chosen, lambda head: head.generation):
            yield generation, {head.evaluation: found[head.evaluation] for head in group}


def recorded_run(bag: Path, run_id: str = "") -> RecordedRun:
    """Find out which episodes a recording contains.

    Args:
        bag: Folder of the recording.
        run_id: Id of the run; empty for the only one that has episodes.

    Raises:
        StorageError: The bag is not a recording, or damaged.
        RequestError: There are no episodes of that run, or no `run_id` is given and there are several runs, or an
            evaluation belongs to two generations.
    """
    heads: dict[str, dict[int, EpisodeHead]] = {}
    seen: dict[str, SeenEpisodes] = {}
    differing: Counter[tuple[str, int]] = Counter()
    for message in read_bag(bag, [TRANSITIONS, METRICS]):
        if message.type_name == METRICS:
            of, committed = _committed(bag, message.data)
            seen.setdefault(of, SeenEpisodes()).committed = committed
            continue
        head = _head(bag, message.data)
        seen.setdefault(head.run_id, SeenEpisodes()).add(head.evaluation)
        before = heads.setdefault(head.run_id, {}).setdefault(head.evaluation, head)
        if before != head:
            differing[head.run_id, head.evaluation] += 1
            heads[head.run_id][head.evaluation] = head
    chosen = _chosen(bag, {name: len(of) for name, of in heads.items()}, run_id)
    ordered = tuple(head for _, head in sorted(heads[chosen].items()))
    _require_order(bag, ordered)
    return RecordedRun(
        bag=bag,
        run_id=chosen,
        task=ordered[-1].task,
        heads=ordered,
        repeated=seen[chosen].repeated,
        differing=tuple(sorted(k for of, k in differing if of == chosen)),
        missing=tuple(seen[chosen].missing()),
    )


def _chosen(bag: Path, counts: dict[str, int], run_id: str) -> str:
    """Return the id of the run to use.

    Raises:
        RequestError: The run is not there, or there are several and none was chosen.
    """
    found = ", ".join(f"{printable(name)} ({count} episodes)" for name, count in counts.items())
    if not counts:
        raise RequestError(
            f"'{bag}' holds no experience (no message of {TRANSITIONS}); record during a run."
        )
    if run_id and run_id not in counts:
        raise RequestError(f"'{bag}' holds no experience of run {run_id}, only of {found}.")
    if not run_id and len(counts) > 1:
        raise RequestError(
            f"'{bag}' holds experience of several runs: {found}; choose one with --run-id."
        )
    return run_id or next(iter(counts))


def _require_order(bag: Path, heads: tuple[EpisodeHead, ...]) -> None:
    generations = [head.generation for head in heads]
    tasks = sorted({head.task for head in heads})
    if generations != sorted(generations) or generations[0] < 0 or len(tasks) > 1:
        raise RequestError(
            f"The episodes in '{bag}' contradict each other: one run has one task ({', '.join(tasks)}), and later "
            "evaluations are of later generations."
        )


def _head(bag: Path, data: bytes) -> EpisodeHead:
    try:
        return episode_head(data)
    except RequestError as error:
        raise _unfit(bag, error) from None


def _committed(bag: Path, data: bytes) -> tuple[str, int]:
    try:
        return committed_evaluations(data)
    except RequestError as error:
        raise _unfit(bag, error) from None


def _episode(bag: Path, data: bytes, spec: TaskSpec) -> Episode:
    try:
        return episode_from_msg(deserialize_message(data, Transitions), spec)
    except Exception as error:  # the middleware may raise anything for bytes that are not a message
        raise _unfit(bag, error) from None


def _unfit(bag: Path, error: Exception) -> StorageError:
    return StorageError(
        f"The recording '{bag}' holds a message that cannot be used: {printable(str(error))} Restore it from a copy, "
        "or record again."
    )
