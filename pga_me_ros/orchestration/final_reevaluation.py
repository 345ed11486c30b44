"""The end of a run: its elites are re-evaluated from other initial poses, by the run's own evaluators."""

from __future__ import annotations

import time
from collections.abc import Callable

from pga_me_ros.arrays import Float32Array
from pga_me_ros.core.archive.corrected import in_words
from pga_me_ros.core.runs.run_directory import RunDirectory
from pga_me_ros.core.storage.reevaluating import Reevaluating, fittest_first
from pga_me_ros.core.storage.reevaluations import RepeatOutcome
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import PgaError, StorageError
from pga_me_ros.orchestration.calls import Waiter
from pga_me_ros.orchestration.evaluator_pool import EvaluatorPool
from pga_me_ros.orchestration.progress import ProgressReporter

PIECE = 25
"""Re-evaluations per evaluator that are handed out at a time; requests with more would only be large."""

LOOK_PERIOD = 1.0
"""Seconds after which it is looked at whether the run is paused, though nothing has come in."""

TELL_PERIOD = 2.0
"""Seconds between two reports of progress."""

SAVE_PERIOD = 10.0
"""Seconds between two writes of what was found so far."""


class FinalReevaluation:
    """Evaluates each elite of a finished run again, as ``reevaluate RUN`` does; what is there is not done twice.

    The repertoire is only read. What is cut off is continued by the next start of the run.

    Args:
        directory: Folder of the run.
        repeats: Wanted re-evaluations of each elite, 0 for none.
        pool: Evaluators.
        waiter: How to wait.
        progress: Where it is reported.
    """

    def __init__(
        self,
        directory: RunDirectory,
        repeats: int,
        pool: EvaluatorPool,
        waiter: Waiter,
        progress: ProgressReporter,
    ) -> None:
        self._directory = directory
        self._repeats = repeats
        self._pool = pool
        self._waiter = waiter
        self._progress = progress

    def is_missing(self) -> bool:
        """Whether the elites that there are now have not been evaluated as often as wanted.

        What keeps this from being known is told by `carry_out`, which must be called anyway.
        """
        if not self._repeats:
            return False
        try:
            run = StoredRun.load(self._directory.repertoire)
        except StorageError:
            return False
        ids = run.archive.evaluations[run.archive.filled_cells()]
        return bool(run.reevaluations.missing(ids, self._repeats))

    def carry_out(self, ready: Callable[[], None], pause: Callable[[], None]) -> None:
        """Do what is missing; a file that cannot be used is reported, as the run itself is finished.

        Args:
            ready: Called before the first evaluation; waits for evaluators.
            pause: Called again and again; waits while the run is paused.

        Raises:
            StoppedError: The run was asked to stop; what was done is stored.
        """
        if not self._repeats:
            return
        try:
            run = StoredRun.load(self._directory.repertoire)
            chosen = fittest_first(run.archive)
            work = Reevaluating(run, chosen, self._repeats)
            try:
                if work.missing:
                    self._begin(len(chosen), len(work.missing))
                    ready()
                    self._evaluate(work, chosen, pause)
                corrected = work.finish(own=True)
            finally:
                work.close()
        except PgaError as error:
            self._progress.say(f"warning: not all elites were re-evaluated: {error}")
            return
        if corrected:
            self._progress.say(
                f"its {corrected.elites} elites on average of {corrected.repeats} or more re-evaluations:"
            )
            for line in in_words(corrected, run.archive):
                self._progress.say(line)

    def _begin(self, elites: int, missing: int) -> None:
        self._progress.reevaluated(0, missing)
        self._progress.say(
            f"evaluates its {elites} elites again from other initial poses, {self._repeats} times each: {missing} "
            "evaluations besides its budget (reevaluations:=0 leaves them out)"
        )

    def _evaluate(
        self, work: Reevaluating, chosen: dict[int, Float32Array], pause: Callable[[], None]
    ) -> None:
        """Hand out what is missing, piece by piece, and take what comes back."""
        left = list(enumerate(work.missing, start=1))
        under_way: dict[int, tuple[int, int]] = {}
        total, saved, told = len(left), time.monotonic(), time.monotonic()
        self._pool.begin(self._directory.settings.generations)
        try:
            while left or under_way:
                pause()
                room = 2 * PIECE * max(1, len(self._pool))
                if left and len(under_way) < room:
                    piece, left = left[:room], left[room:]
                    under_way |= {-k: job for k, job in piece}
                    keys, jobs = [-k for k, _ in piece], [job for _, job in piece]
                    self._pool.submit(
                        keys, [chosen[evaluation] for evaluation, _ in jobs], again=jobs
                    )
                few = min(len(under_way), room) - 1 if left else 0
                self._waiter.until(lambda: self._unfinished(under_way) <= few, LOOK_PERIOD)  # noqa: B023
                work.take(self._finished(under_way))
                done = total - len(left) - len(under_way)
                if done == total or time.monotonic() > told + TELL_PERIOD:
                    self._progress.reevaluated(done, total)
                    told = time.monotonic()
                if time.monotonic() > saved + SAVE_PERIOD:
                    work.save()
                    saved = time.monotonic()
        finally:
            work.save()

    def _unfinished(self, under_way: dict[int, tuple[int, int]]) -> int:
        return len(under_way) - len(self._pool.finished(list(under_way)))

    def _finished(self, under_way: dict[int, tuple[int, int]]) -> list[RepeatOutcome]:
        """Return the outcomes that have come in, and take them out of what is under way."""
        keys = self._pool.finished(list(under_way))
        return [
            RepeatOutcome(
                *under_way.pop(key), done.fitness, done.descriptor, done.length, done.terminated
            )
            for key, done in zip(keys, self._pool.outcomes(keys), strict=True)
        ]
