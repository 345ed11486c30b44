"""Intelligent Trial and Error: a dozen trials on the robot, guided by what its repertoire promised when it was sound.

Cully, Clune, Tarapore & Mouret, *Robots that can adapt like animals* (Nature 2015, arXiv 1407.3501), Algorithm 1: a
Gaussian process over the descriptor space corrects the repertoire's promises by what trials achieved. The behavior
with the greatest upper confidence bound is tried next, until a trial reached 90 % of the best that is still expected.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pga_me_ros.arrays import Float64Array
from pga_me_ros.core.adaptation.gaussian_process import averaged_posterior, posterior
from pga_me_ros.core.adaptation.performance_map import PerformanceMap
from pga_me_ros.core.settings.field import INT64_MAX, setting
from pga_me_ros.errors import RequestError, SettingsError

SMALLEST_SCALE = 1e-6
"""Smallest length scale that can be computed with."""

SCALES = 5
"""Number of length scales that are averaged."""


@dataclass(frozen=True)
class AdaptationSettings:
    """How behaviors are chosen; the defaults are the paper's."""

    budget: int = setting(20, "Most trials.", low=1, high=INT64_MAX, unit="trials")
    length_scale: float = setting(
        0.4,
        "Distance over which behaviors tell about each other, in shares of the descriptor's range (the paper's rho).",
        low=SMALLEST_SCALE,
        high=1e6,
    )
    least_length_scale: float = setting(
        0.0,
        "If above 0, the length scale is inferred from the trials: several from this one to length_scale are averaged, "
        "each by how well it explains what was achieved.",
        low=0.0,
        high=1e6,
    )
    noise: float = setting(
        0.001,
        "Variance of a trial's noise, in squared shares of the best promise (the paper's sigma_noise²).",
        low=1e-9,
        high=1e3,
    )
    kappa: float = setting(
        0.05,
        "Weight of the uncertainty in the upper confidence bound, in shares of the best promise.",
        low=0.0,
        high=1e3,
    )
    enough: float = setting(
        0.9,
        "Share of the best that is expected anywhere that a trial must reach to be the last one (the paper's alpha).",
        low=0.0,
        high=1.0,
    )

    def __post_init__(self) -> None:
        """Check that the least length scale is the lesser one.

        Raises:
            SettingsError: It is not, or too small to compute with.
        """
        least, greatest = self.least_length_scale, self.length_scale
        if least and not SMALLEST_SCALE <= least < greatest:
            raise SettingsError(
                f"least_length_scale is {least:g}; expected 0, or a value from {SMALLEST_SCALE:g} up to below "
                f"length_scale, which is {greatest:g}."
            )

    @property
    def length_scales(self) -> Float64Array:
        """(k,) float64 length scales that count: the one, or several at equal ratios."""
        if not self.least_length_scale:
            return np.array([self.length_scale])
        return np.geomspace(self.least_length_scale, self.length_scale, SCALES)


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

    Attributes:
        trials: All trials in their order.
        settings: How behaviors are chosen.

    Raises:
        RequestError: `floor` is not below the best promise.
    """

    def __init__(
        self,
        promises: PerformanceMap,
        settings: AdaptationSettings | None = None,
        trials: Iterable[Trial] = (),
        floor: float | None = None,
    ) -> None:
        self.settings = settings or AdaptationSettings()
        self.trials = list(trials)
        self._floor = floor
        self.promises = promises

    @property
    def promises(self) -> PerformanceMap:
        """What the repertoire promises."""
        return self._promises

    @promises.setter
    def promises(self, promises: PerformanceMap) -> None:
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
        """Whether a trial reached the share `enough` of the best that is expected anywhere (the paper's rule)."""
        best = self.best
        if best is None or best.achieved is None:
            return False
        expected = (float(self.estimate[0].max()) - self._base) / self._span
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
        dimensions = p.descriptors.shape[1]
        tried = np.array([t.descriptor for t in done], np.float64).reshape(len(done), dimensions)
        missed = [(t.achieved or 0.0) - t.promised for t in done]
        shares = np.array(missed, np.float64) / self._span
        observed = (p.points, p.scaled(tried), shares)
        if s.least_length_scale:
            means, deviations = averaged_posterior(*observed, s.length_scales.tolist(), s.noise)
        else:
            means, deviations = posterior(*observed, s.length_scale, s.noise)
        return p.fitness + self._span * means, self._span * deviations

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
