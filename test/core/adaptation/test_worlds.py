"""A robot that may be in other worlds: what is expected then, which behaviors are tried, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.core.adaptation.adaptation import Adaptation
from pga_me_ros.core.adaptation.adaptation_settings import AdaptationSettings
from pga_me_ros.core.adaptation.performance_map import PerformanceMap
from pga_me_ros.core.archive.worlds import Worlds
from pga_me_ros.core.storage.reevaluations import Reevaluations, RepeatOutcome
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.core.storage.stored_worlds import worlds_of
from pga_me_ros.errors import RequestError

N = 30
SHAPES = ((0.1, 1000.0), (0.5, 900.0), (0.9, 700.0))
"""Place and height of what is best: as promised, and in each of two worlds."""


def peaks() -> list[np.ndarray]:
    places = np.linspace(0.0, 1.0, N)
    return [height * np.exp(-(((places - at) / 0.15) ** 2)) for at, height in SHAPES]


def promises() -> PerformanceMap:
    return PerformanceMap(
        cells=np.arange(N),
        evaluations=np.arange(N) * 2 + 7,
        descriptors=np.linspace(0.0, 1.0, N)[:, None],
        fitness=peaks()[0],
        low=np.zeros(1),
        high=np.ones(1),
    )


def worlds() -> Worlds:
    return Worlds(promises().evaluations, np.stack(peaks()[1:]))


def adapt(adaptation: Adaptation, robot: np.ndarray) -> list[int]:
    while trial := adaptation.next():
        adaptation.report(float(robot[trial.cell]))
    return [trial.cell for trial in adaptation.trials]


@pytest.mark.parametrize("least", [0.0, 0.05])
def test_the_estimate_is_that_of_scikit_learns_processes_by_their_evidence(least: float) -> None:
    gaussian = pytest.importorskip("sklearn.gaussian_process")
    settings = AdaptationSettings(
        sound=0.4, spread=0.2, least_length_scale=least, enough=1.0, noise=0.01
    )
    adaptation = Adaptation(promises(), settings, worlds=worlds())
    for achieved in (50.0, 300.0, 120.0):
        assert adaptation.next()
        adaptation.report(achieved)
    points = promises().points
    rows = [t.cell for t in adaptation.trials]
    reported = np.array([t.achieved for t in adaptation.trials])
    logs, means, variances = [], [], []
    for fitness, variance, prior in zip(peaks(), (1.0, 0.04, 0.04), (0.4, 0.3, 0.3), strict=True):
        for scale in settings.length_scales:
            kernel = gaussian.kernels.ConstantKernel(variance) * gaussian.kernels.Matern(
                scale, nu=2.5
            )
            oracle = gaussian.GaussianProcessRegressor(kernel, alpha=0.01, optimizer=None)
            best = peaks()[0].max()
            oracle.fit(points[rows], (reported - fitness[rows]) / best)
            mean, deviation = oracle.predict(points, return_std=True)
            logs.append(np.log(prior) + oracle.log_marginal_likelihood())
            means.append(fitness + best * mean)
            variances.append((best * deviation) ** 2)
    weights = np.exp(np.array(logs) - max(logs))
    weights /= weights.sum()
    mean = weights @ np.array(means)
    variance = weights @ (np.array(variances) + (np.array(means) - mean) ** 2)
    got_means, got_deviations = adaptation.estimate
    np.testing.assert_allclose(got_means, mean, rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(got_deviations, np.sqrt(variance), rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("world", [0, 1, 2])
def test_trials_tell_which_world_it_is(world: int) -> None:
    robot = peaks()[world]
    with_worlds = Adaptation(promises(), worlds=worlds())
    cells = adapt(with_worlds, robot)
    assert with_worlds.best is not None
    assert with_worlds.best.achieved is not None
    assert with_worlds.best.achieved > 0.9 * robot.max()
    assert len(cells) <= 3
    assert adapt(Adaptation(promises(), worlds=worlds()), robot) == cells, "repeatable"


def test_a_robot_that_is_surely_sound_is_as_without_worlds() -> None:
    sound = Adaptation(promises(), AdaptationSettings(sound=1.0), worlds=worlds())
    alone = Adaptation(promises())
    assert adapt(sound, peaks()[2]) == adapt(alone, peaks()[2])
    np.testing.assert_allclose(sound.estimate[0], alone.estimate[0])


def test_only_what_is_known_in_the_worlds_is_tried() -> None:
    known = promises().evaluations[::3]
    some = Worlds(known, np.stack(peaks()[1:])[:, ::3])
    adaptation = Adaptation(promises(), AdaptationSettings(enough=1.0), worlds=some)
    assert adaptation.promises.evaluations.tolist() == known.tolist()
    assert set(adapt(adaptation, peaks()[1])) <= set(range(0, N, 3))
    adaptation.promises = promises()  # the repertoire has grown
    assert len(adaptation.promises.cells) == len(known)
    strange = Worlds(np.array([1000]), np.ones((2, 1)))
    with pytest.raises(RequestError, match="None of the behaviors that may be tried is known"):
        Adaptation(promises(), worlds=strange)


def test_trials_of_a_behavior_that_was_replaced_still_count() -> None:
    adaptation = Adaptation(promises(), AdaptationSettings(enough=1.0), worlds=worlds())
    trial = adaptation.next()
    assert trial is not None
    adaptation.report(0.0)
    adaptation.promises = promises().only(promises().evaluations != trial.evaluation)
    again = adaptation.next()
    assert again is not None
    assert abs(again.descriptor[0] - trial.descriptor[0]) > 0.2


def test_trials_that_were_made_without_the_worlds_are_refused() -> None:
    before = Adaptation(promises())
    before.next()
    before.report(10.0)
    only_last = Worlds(promises().evaluations[-1:], np.ones((2, 1)))
    with pytest.raises(RequestError, match="not known in the worlds; start anew"):
        Adaptation(promises(), trials=before.trials, worlds=only_last)


@pytest.mark.parametrize(
    ("evaluations", "fitness", "words"),
    [
        ([1, 2], np.ones((3, 1)), "the shape"),
        ([1, 2], np.ones(2), "the shape"),
        ([2, 1], np.ones((3, 2)), "out of order"),
        ([1, 1], np.ones((3, 2)), "out of order"),
        ([1, 2], np.array([[1.0, np.nan]]), "not finite"),
    ],
)
def test_worlds_that_make_no_sense_are_refused(
    evaluations: list[int], fitness: np.ndarray, words: str
) -> None:
    with pytest.raises(RequestError, match=words):
        Worlds(np.array(evaluations), fitness)


def stored(text: str, repeats: dict[int, int]) -> Reevaluations:
    """Return re-evaluations: so many repeats of each elite, whose fitness says which elite and repeat it is."""
    outcomes = [
        RepeatOutcome(e, r, 100.0 * e + r, np.zeros(1), 10, False)
        for e, count in repeats.items()
        for r in range(count)
    ]
    return Reevaluations.none("run", 1, text).with_more(outcomes[::-1])


def test_each_repeat_that_all_elites_have_is_a_world() -> None:
    found = worlds_of([stored("mass 1 2", {5: 3, 2: 2, 9: 4})])
    assert found is not None
    assert found.evaluations.tolist() == [2, 5, 9]
    assert found.fitness.tolist() == [[200.0, 500.0, 900.0], [201.0, 501.0, 901.0]]


def test_the_worlds_of_several_files_are_those_of_the_elites_in_all() -> None:
    found = worlds_of([stored("mass 1 2", {2: 1, 5: 1}), stored("friction 0 1", {9: 2, 5: 2})])
    assert found is not None
    assert found.evaluations.tolist() == [5]
    assert found.fitness.tolist() == [[500.0], [500.0], [501.0]]
    assert worlds_of([stored("mass 1 2", {2: 1}), stored("friction 0 1", {9: 2})]) is None
    assert worlds_of([stored("mass 1 2", {})]) is None
    assert worlds_of([]) is None


@pytest.mark.parametrize("name", ["qd_hopper", "qd_walker", "qd_half_cheetah", "qd_ant"])
def test_the_shipped_repertoires_know_what_they_achieve_in_other_worlds(name: str) -> None:
    run = StoredRun.load(f"zoo/{name}")
    assert run.worlds is not None
    cells = run.archive.filled_cells()
    assert run.worlds.known(run.archive.evaluations[cells]).all()
    assert len(run.worlds.fitness) == 20


def test_a_run_without_them_has_no_worlds(hopper_run: Path) -> None:
    assert StoredRun.load(hopper_run).worlds is None
