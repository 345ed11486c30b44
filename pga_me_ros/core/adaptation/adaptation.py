"""Intelligent Trial and Error: a dozen trials on the robot, guided by what its repertoire promised when it was sound.

Cully, Clune, Tarapore & Mouret, *Robots that can adapt like animals* (Nature 2015, arXiv 1407.3501), Algorithm 1: a
Gaussian process over the descriptor space corrects the repertoire's promises by what trials achieved. The behavior
with the greatest upper confidence bound is tried next, until a trial reached 90 % of the best that is still expected.

With worlds, the robot may be in any of them, too: what behaviors achieve there is promised as well, and trials tell
which promises hold.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.adaptation.adaptation_settings import AdaptationSettings
from pga_me_ros.core.adaptation.gaussian_process import (
    averaged_posterior,
    log_likelihood,
    mixture,
    posterior,
)
from pga_me_ros.core.adaptation.performance_map import PerformanceMap
from pga_me_ros.core.archive.worlds import Worlds
from pga_me_ros.errors import RequestError


@dataclass(frozen=True, eq=False)
class Trial:
    """One behavior that was given out to be tried.

    Attributes:
        number: 1 for the first.
        cell: Its cell.
        evaluation: The evaluation that it was found with.
        descriptor: (d,) float64.
        promised: Fitness that the repertoire promises.
        expected: Fitness that was expected of it before the trial.
        uncertainty: Standard deviation of that.
        achieved: Fitness that the trial achieved, None while it was not reported.
        given_up: Whether it will not be reported.
    """

    number: int
    cell: int
    evaluation: int
    descriptor: Float64Array = field(repr=False)
    promised: float
    expected: float
    uncertainty: float
    achieved: float | None = None
    given_up: bool = False

    @property
    def open(self) -> bool:
        """Whether its report is still awaited."""
        return self.achieved is None and not self.given_up


class Adaptation:
    """Chooses which behavior to try next, and knows when to stop.

    ::

        adaptation = Adaptation(PerformanceMap.of(run.choices()))
        while trial := adaptation.next():
            adaptation.report(try_on_the_robot(run.choose(cell=trial.cell)))
        print(adaptation.best)

    Equal maps, settings and reports give equal trials.

    Args:
        promises: What the repertoire promises; to be replaced while it grows.
        settings: How behaviors are chosen.
        trials: Trials of an earlier session to continue.
        floor: Fitness that counts as nothing achieved, from where shares count; None for 0, or for the least promise if
            that is below 0.
        worlds: Other worlds that the robot may be in (``run.worlds``); only behaviors that are known in them are tried.

    Attributes:
        trials: All trials in their order.
        settings: How behaviors are chosen.
        worlds: Other worlds that the robot may be in.

    Raises:
        RequestError: `floor` is not below the best promise, or no behavior of the map, or not all of the trials', is
            known in the worlds.
    """

    def __init__(
        self,
        promises: PerformanceMap,
        settings: AdaptationSettings | None = None,
        trials: Iterable[Trial] = (),
        floor: float | None = None,
        worlds: Worlds | None = None,
    ) -> None:
        self.settings = settings or AdaptationSettings()
        self.trials = list(trials)
        self.worlds = worlds
        self._floor = floor
        if worlds:
            tried = np.array([t.evaluation for t in self.trials], np.int64)
            if not worlds.known(tried).all():
                raise RequestError(
                    "Trials were made with behaviors that are not known in the worlds; start anew, or leave the worlds "
                    "out."
                )
        self.promises = promises

    @property
    def promises(self) -> PerformanceMap:
        """What the repertoire promises."""
        return self._promises

    @promises.setter
    def promises(self, promises: PerformanceMap) -> None:
        if self.worlds:
            known = self.worlds.known(promises.evaluations)
            if not known.any():
                raise RequestError(
                    "None of the behaviors that may be tried is known in the worlds; evaluate them there (reevaluate "
                    "RUN --randomization TEXT), or leave the worlds out."
                )
            promises = promises.only(known)
        floor = min(0.0, float(promises.fitness.min())) if self._floor is None else self._floor
        best = float(promises.fitness.max())
        if not floor < best:
            if self._floor is not None:
                raise RequestError(
                    f"floor is {floor:g}, but the best behavior promises {best:g}; give what counts as nothing."
                )
            floor = best - 1.0
        self._promises, self._base, self._span = promises, floor, best - floor
        self._forget()

    def next(self) -> Trial | None:
        """Return the trial to make next, None when adaptation is over; the same one again until it was reported."""
        if self.trials and self.trials[-1].open:
            return self.trials[-1]
        if self.over:
            return None
        chosen = self._choose()
        means, deviations = self.estimate
        p = self._promises
        trial = Trial(
            len(self.trials) + 1,
            int(p.cells[chosen]),
            int(p.evaluations[chosen]),
            p.descriptors[chosen].copy(),
            float(p.fitness[chosen]),
            float(means[chosen]),
            float(deviations[chosen]),
        )
        self.trials.append(trial)
        return trial

    def report(self, achieved: float, number: int | None = None) -> Trial:
        """Tell what the open trial achieved.

        Args:
            achieved: Fitness.
            number: Number of the trial, None for the open one.

        Returns:
            The trial.

        Raises:
            RequestError: No such trial is open, or the fitness is NaN or infinite.
        """
        trial = self._open(number)
        if not math.isfinite(achieved):
            raise RequestError(
                f"Trial {trial.number} is reported to have achieved {achieved}; report a finite fitness, or give the "
                "trial up. It is still open."
            )
        return self._close(replace(trial, achieved=float(achieved)))

    def give_up(self, number: int | None = None) -> Trial:
        """Tell that the open trial will not be reported; its behavior is not tried again.

        Raises:
            RequestError: No such trial is open.
        """
        return self._close(replace(self._open(number), given_up=True))

    @property
    def best(self) -> Trial | None:
        """The trial that achieved most, the earlier one of equals; None before the first report."""
        done = self._done
        return max(done, key=lambda t: (t.achieved, -t.number)) if done else None

    @property
    def adapted(self) -> bool:
        """Whether a trial reached the share `enough` of the best that is expected anywhere (the paper's rule).

        What was given up is not expected of anything any more.
        """
        best, allowed = self.best, self._allowed
        if best is None or best.achieved is None or not allowed.any():
            return False
        expected = (float(self.estimate[0][allowed].max()) - self._base) / self._span
        return (best.achieved - self._base) / self._span >= self.settings.enough * expected

    @property
    def over(self) -> bool:
        """Whether no further trial is to be made."""
        if self.trials and self.trials[-1].open:
            return False
        spent = len(self.trials) >= self.settings.budget
        return spent or self.adapted or not self._allowed.any()

    @cached_property
    def estimate(self) -> tuple[Float64Array, Float64Array]:
        """(n,) float64 fitness that is expected of each behavior of the map, and (n,) float64 standard deviation."""
        p, s, done = self._promises, self.settings, self._done
        missed = [(t.achieved or 0.0) - t.promised for t in done]
        shares = np.array(missed, np.float64) / self._span
        observed = (p.points, self._tried, shares)
        if self.worlds:
            return self._estimate_with(self.worlds, shares)
        if s.least_length_scale:
            means, deviations = averaged_posterior(*observed, s.length_scales.tolist(), s.noise)
        else:
            means, deviations = posterior(*observed, s.length_scale, s.noise)
        return p.fitness + self._span * means, self._span * deviations

    def _estimate_with(
        self, worlds: Worlds, shares: Float64Array
    ) -> tuple[Float64Array, Float64Array]:
        """Return the estimate where the robot may be in other worlds: all count by how well they explain the trials.

        Args:
            worlds: The worlds.
            shares: (t,) float64 by which trials missed what the repertoire promised.
        """
        p, s = self._promises, self.settings
        there = worlds.promises(p.evaluations)
        evaluations = np.array([t.evaluation for t in self._done], np.int64)
        achieved = np.array([t.achieved for t in self._done], np.float64)
        share = (1.0 - s.sound) / max(len(there), 1)
        possible = [(p.fitness, shares, 1.0, s.sound)]
        if share:
            missed = (achieved - worlds.promises(evaluations)) / self._span
            rows = zip(there, missed, strict=True)
            possible += [(fitness, misses, s.spread**2, share) for fitness, misses in rows]
        parts, logs = [], []
        for promised, misses, variance, probability in possible:
            for scale in s.length_scales.tolist():
                means, deviations = posterior(
                    p.points, self._tried, misses, scale, s.noise, variance
                )
                parts.append((promised + self._span * means, self._span * deviations))
                logs.append(
                    math.log(probability)
                    + log_likelihood(self._tried, misses, scale, s.noise, variance)
                )
        return mixture(parts, logs)

    @property
    def _tried(self) -> Float64Array:
        """(t, d) float64 descriptors of the reported trials in shares of their range."""
        dimensions = self._promises.descriptors.shape[1]
        tried = [t.descriptor for t in self._done]
        return self._promises.scaled(np.array(tried, np.float64).reshape(len(tried), dimensions))

    @property
    def _done(self) -> list[Trial]:
        return [t for t in self.trials if t.achieved is not None]

    @property
    def _allowed(self) -> np.ndarray:
        """(n,) bool: which behaviors of the map may be tried."""
        given_up = [t.evaluation for t in self.trials if t.given_up]
        return ~np.isin(self._promises.evaluations, given_up)

    def _choose(self) -> int:
        """Return the row with the greatest upper confidence bound, the one of the lowest cell among equals."""
        means, deviations = self.estimate
        bounds = means + self.settings.kappa * deviations
        return int(np.argmax(np.where(self._allowed, bounds, -np.inf)))

    def _open(self, number: int | None) -> Trial:
        last = self.trials[-1] if self.trials else None
        if number is not None and not 1 <= number <= len(self.trials):
            raise RequestError(
                f"There is no trial {number}; {len(self.trials)} were given out. Ask for the next one first."
            )
        if last is None or not last.open or number not in (None, last.number):
            which = "No trial is open" if number is None else f"Trial {number} is not open"
            raise RequestError(
                f"{which}: it was reported or given up before; ask for the next one."
            )
        return last

    def _close(self, trial: Trial) -> Trial:
        self.trials[-1] = trial
        self._forget()
        return trial

    def _forget(self) -> None:
        self.__dict__.pop("estimate", None)
