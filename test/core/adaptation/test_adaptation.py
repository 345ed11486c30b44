"""Intelligent Trial and Error: which behavior is tried next, when it stops, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pga_me_ros.core.adaptation.adaptation import Adaptation
from pga_me_ros.core.adaptation.adaptation_settings import AdaptationSettings
from pga_me_ros.core.adaptation.performance_map import PerformanceMap
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError, SettingsError

N = 41
PLACES = np.linspace(0.0, 1.0, N)


def promises(fitness: np.ndarray | None = None, scale: float = 1.0) -> PerformanceMap:
    """Return a map over one dimension, in units of its own, whose best behavior is at 0.2."""
    own = 1000.0 * np.exp(-((PLACES - 0.2) ** 2)) if fitness is None else fitness
    return PerformanceMap(
        cells=np.arange(N) * 3,
        evaluations=np.arange(N) + 100,
        descriptors=scale * PLACES[:, None],
        fitness=own,
        low=np.zeros(1),
        high=np.array([scale]),
    )


def damaged(descriptor: float) -> float:
    """Return what the damaged robot achieves: nothing near 0.2, much at 0.8."""
    return 800.0 * float(np.exp(-(((descriptor - 0.8) / 0.2) ** 2)))


def adapt(adaptation: Adaptation, scale: float = 1.0) -> list[int]:
    while trial := adaptation.next():
        adaptation.report(damaged(float(trial.descriptor[0]) / scale))
    return [trial.cell for trial in adaptation.trials]


def test_it_begins_with_the_best_promise_and_finds_what_works() -> None:
    adaptation = Adaptation(promises())
    cells = adapt(adaptation)
    assert cells[0] == 3 * 8
    assert adaptation.over
    assert adaptation.adapted
    assert adaptation.best is not None
    assert adaptation.best.achieved is not None
    assert adaptation.best.achieved > 0.9 * 800.0
    assert 2 <= len(cells) <= 12
    assert adaptation.next() is None


def test_a_sound_robot_stops_after_the_first_trial() -> None:
    adaptation = Adaptation(promises())
    trial = adaptation.next()
    assert trial is not None
    adaptation.report(trial.promised)
    assert adaptation.adapted
    assert adaptation.next() is None


def test_the_units_of_descriptors_do_not_matter_and_trials_are_repeatable() -> None:
    cells = adapt(Adaptation(promises()))
    assert adapt(Adaptation(promises())) == cells
    assert adapt(Adaptation(promises(scale=50.0)), scale=50.0) == cells


def test_the_estimate_is_the_promise_corrected_near_what_was_tried() -> None:
    adaptation = Adaptation(promises())
    means, deviations = adaptation.estimate
    np.testing.assert_array_equal(means, promises().fitness)
    assert (deviations == 1000.0).all()
    trial = adaptation.next()
    assert trial is not None
    adaptation.report(0.0)
    means, deviations = adaptation.estimate
    row = trial.cell // 3
    assert means[row] < 0.01 * trial.promised
    assert deviations[row] == deviations.min() < 40.0
    lost = promises().fitness - means
    assert (np.diff(lost[row:]) < 0.0).all(), "the farther, the less was learned"


def test_an_inferred_length_scale_generalizes_as_far_as_trials_agree() -> None:
    """All fail at first, so that failure counts farther than with the least length scale alone."""
    inferred = Adaptation(promises(), AdaptationSettings(least_length_scale=0.02))
    near = Adaptation(promises(), AdaptationSettings(length_scale=0.02))
    assert inferred.settings.length_scales[[0, -1]].tolist() == pytest.approx([0.02, 0.4])
    cells = adapt(inferred)
    assert len(cells) < len(adapt(near))
    assert inferred.best is not None
    assert inferred.best.achieved is not None
    assert inferred.best.achieved > 0.9 * 800.0


@pytest.mark.parametrize("least", [0.4, 1.0, 1e-9])
def test_a_least_length_scale_out_of_range_is_refused(least: float) -> None:
    with pytest.raises(SettingsError, match="up to below length_scale"):
        AdaptationSettings(least_length_scale=least)


def test_a_budget_ends_it_without_success() -> None:
    adaptation = Adaptation(promises(), AdaptationSettings(budget=3, enough=1.0))
    while adaptation.next():
        adaptation.report(-5.0)
    assert len(adaptation.trials) == 3
    assert adaptation.over
    assert not adaptation.adapted


def test_a_trial_is_given_out_again_until_it_is_reported_and_reported_once() -> None:
    adaptation = Adaptation(promises())
    first = adaptation.next()
    assert first is not None
    assert adaptation.next() is first
    for wrong in (float("nan"), float("inf")):
        with pytest.raises(RequestError, match="report a finite fitness"):
            adaptation.report(wrong)
    with pytest.raises(RequestError, match="There is no trial 2; 1 were given out"):
        adaptation.report(1.0, number=2)
    assert adaptation.next() is first
    adaptation.report(10.0, number=1)
    with pytest.raises(RequestError, match="Trial 1 is not open: it was reported"):
        adaptation.report(20.0, number=1)
    with pytest.raises(RequestError, match="No trial is open"):
        adaptation.report(20.0)
    assert adaptation.trials[0].achieved == 10.0


def test_what_was_given_up_is_not_tried_again_and_tells_nothing() -> None:
    adaptation = Adaptation(promises())
    first = adaptation.next()
    assert first is not None
    adaptation.give_up()
    np.testing.assert_array_equal(adaptation.estimate[0], promises().fitness)
    second = adaptation.next()
    assert second is not None
    assert second.cell != first.cell
    assert second.number == 2


def test_it_ends_when_all_were_given_up() -> None:
    adaptation = Adaptation(promises(), AdaptationSettings(budget=100))
    while adaptation.next():
        adaptation.give_up()
    assert len(adaptation.trials) == N
    assert not adaptation.adapted


def test_what_was_given_up_is_not_expected_any_more() -> None:
    fitness = np.full(N, 49.0)
    fitness[[0, N - 1]] = 100.0, 50.0
    adaptation = Adaptation(promises(fitness))
    first = adaptation.next()
    assert first is not None
    assert first.cell == 0
    adaptation.give_up()
    second = adaptation.next()
    assert second is not None
    adaptation.report(50.0)
    assert adaptation.adapted
    assert adaptation.next() is None


def test_an_earlier_session_is_continued() -> None:
    whole = Adaptation(promises())
    adapt(whole)
    begun = Adaptation(promises(), trials=whole.trials[:2])
    adapt(begun)
    assert [t.cell for t in begun.trials] == [t.cell for t in whole.trials]


def test_a_repertoire_may_grow_meanwhile() -> None:
    adaptation = Adaptation(promises())
    adaptation.next()
    adaptation.report(0.0)
    grown = promises()
    better = np.where(PLACES == 0.8, 5000.0, grown.fitness)
    adaptation.promises = replace(grown, fitness=better)
    trial = adaptation.next()
    assert trial is not None
    assert trial.descriptor[0] == pytest.approx(0.8)
    assert adaptation.trials[0].promised == 1000.0


@pytest.mark.parametrize("offset", [0.0, -5000.0])
def test_fitness_below_zero_counts_from_the_least_promise(offset: float) -> None:
    adaptation = Adaptation(promises(promises().fitness + offset))
    trial = adaptation.next()
    assert trial is not None
    adaptation.report(trial.promised)
    assert adaptation.adapted


def test_equal_promises_are_tried_from_the_lowest_cell_on() -> None:
    first = Adaptation(promises(np.full(N, -3.0))).next()
    assert first is not None
    assert first.cell == 0


def test_bad_maps_are_refused() -> None:
    good = promises()
    with pytest.raises(RequestError, match="The repertoire is empty"):
        replace(
            good,
            cells=good.cells[:0],
            evaluations=good.evaluations[:0],
            descriptors=good.descriptors[:0],
            fitness=good.fitness[:0],
        )
    with pytest.raises(RequestError, match="NaN"):
        promises(np.full(N, np.nan))
    with pytest.raises(RequestError, match="shapes"):
        replace(good, fitness=np.zeros(3))
    with pytest.raises(RequestError, match="twice"):
        replace(good, cells=np.zeros(N, np.int64))
    with pytest.raises(RequestError, match="floor is 5000"):
        Adaptation(good, floor=5000.0)


def test_a_stored_repertoire_promises_the_means_of_its_behaviors() -> None:
    run = StoredRun.load("zoo/qd_hopper")
    found = PerformanceMap.of(run.choices())
    assert len(found.cells) == len(run.archive)
    best = run.choose()
    row = int(np.argmax(found.fitness))
    assert found.cells[row] == best.cell
    assert found.fitness[row] == best.promised_fitness
    np.testing.assert_array_equal(found.descriptors[row], best.promised_descriptor)
