"""What the demonstration does with a damaged robot: its trials, and what they are compared with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pga_me_msgs.msg import AdaptationEstimate, AdaptationTrial

from pga_me_ros.adapt_demo.robot import CLIMB_TRIALS, POSES, Achieved, Controller, Robot, Way
from pga_me_ros.arrays import Float64Array
from pga_me_ros.client import Adapter, Behavior
from pga_me_ros.core.adaptation.alternatives import random_search
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.tasks.rollout import Episode

Tell = Callable[[str], object]


@dataclass(frozen=True, eq=False)
class Map:
    """What is expected of each behavior at some moment.

    Attributes:
        descriptors: (n, d) float64.
        promised: (n,) float64 fitness.
        expected: (n,) float64 fitness.
        uncertainty: (n,) float64 standard deviation of that.
    """

    descriptors: Float64Array
    promised: Float64Array
    expected: Float64Array
    uncertainty: Float64Array

    @classmethod
    def of(cls, estimate: AdaptationEstimate) -> Map:
        """Return the map in a message."""
        descriptors = np.array(estimate.descriptors).reshape(len(estimate.cells), -1)
        numbers = (estimate.promised, estimate.expected, estimate.uncertainty)
        return cls(descriptors, *(np.array(values) for values in numbers))


@dataclass(frozen=True, eq=False)
class Step:
    """One trial.

    Attributes:
        before: What was expected before it.
        row: Row of the behavior in that map.
        trial: The trial, before it was reported.
        episode: What came of it.
    """

    before: Map
    row: int
    trial: AdaptationTrial
    episode: Episode


@dataclass(frozen=True, eq=False)
class Found:
    """A gait, and what it achieves on average.

    Attributes:
        name: How it was found.
        average: What it achieves.
    """

    name: str
    average: Achieved


@dataclass(frozen=True, eq=False)
class Trials:
    """An adaptation from start to end.

    Attributes:
        steps: Its trials.
        after: What was expected after the last one.
        adapted: Whether it ended because the best trial achieved what is to be expected.
        best: The behavior of the best trial.
    """

    steps: list[Step]
    after: Map
    adapted: bool
    best: Behavior


def make_trials(adapter: Adapter, robot: Robot, budget: int, repeat: int, tell: Tell) -> Trials:
    """Let a robot try what the adapter gives it.

    Args:
        adapter: Client of the adapter.
        robot: The damaged robot.
        budget: Most trials.
        repeat: Which poses it begins them in.
        tell: Takes a line about each trial.
    """
    rng, steps = Way.ADAPT.generator(repeat), list[Step]()

    def attempt(behavior: Behavior) -> float:
        estimate = adapter.status()
        trial = estimate.trials[-1]
        row = list(estimate.cells).index(trial.cell)
        episode = robot.trial(behavior.controller, rng)
        steps.append(Step(Map.of(estimate), row, trial, episode))
        tell(trial_row(steps[-1], behavior.controller.control_period))
        return episode.fitness

    result = adapter.adapt(attempt, budget=budget, anew=True)
    assert result.behavior is not None, "each trial was reported"
    return Trials(steps, Map.of(adapter.status()), result.adapted, result.behavior)


def compare(
    run: StoredRun, robot: Robot, trials: Trials, promised: Achieved, repeat: int
) -> list[Found]:
    """Return what the damaged robot achieves by adaptation and otherwise, the least effort first.

    Args:
        run: The repertoire.
        robot: The damaged robot.
        trials: What adaptation came to.
        promised: What the gait with the best promise achieves.
        repeat: Which draws the others make.
    """
    count = len(trials.steps)
    rng = Way.RANDOM.generator(repeat)
    cells = run.choices().cells().tolist()
    cell = random_search(
        cells, count, lambda c: robot.trial(run.behavior(c).controller, rng).fitness, rng
    )
    climbed = robot.climb(run.shape, run.choose().parameters, Way.CLIMB.generator(repeat))
    ways: dict[str, Controller] = {
        f"random search, {in_words(count)}": run.behavior(cell).controller,
        f"hill climb, {in_words(CLIMB_TRIALS)}": climbed,
        f"adaptation, {in_words(count)}": trials.best.controller,
    }
    others = [Found(name, robot.average(controller)) for name, controller in ways.items()]
    return [Found("the promised gait", promised), *others]


def ending(trials: Trials) -> str:
    """Return how the trials ended, in words."""
    count, cell = in_words(len(trials.steps)), trials.best.cell
    if trials.adapted:
        return f"over after {count}: no gait is expected to do much better than that of cell {cell}"
    return f"over after {count}, all that there were; the best gait was that of cell {cell}"


def in_words(count: int) -> str:
    """Return a number of trials in words."""
    return f"{count} trial{'' if count == 1 else 's'}"


TRIAL_HEADS = f"{'trial':>5}  {'cell':>5}  {'promised':>8}  {'expected':>8}  {'achieved':>8}"


def trial_row(step: Step, period: float) -> str:
    """Return a line on a trial, under `TRIAL_HEADS`.

    Args:
        step: The trial.
        period: Control period, s.
    """
    t, episode = step.trial, step.episode
    how = "fell after" if episode.terminated else "went on for"
    return (
        f"{t.number:5}  {t.cell:5}  {t.promised:8.0f}  {t.expected:8.0f}  {episode.fitness:8.0f}"
        f"   {how} {episode.length * period:.1f} s"
    )


def found_row(found: Found) -> str:
    """Return a line on a gait."""
    average = found.average
    return f"  {found.name:28}  {average.fitness:6.0f}   fell {average.falls} of {POSES} times"
