"""What reports make of re-evaluations: corrected columns and archives, and what survives in another world."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest

from pga_me_ros.core.archive.corrected import (
    CorrectedMetrics,
    corrected_archive,
    corrected_owners,
    steady_archive,
)
from pga_me_ros.core.archive.heatmap import draw_heatmap
from pga_me_ros.core.storage.reevaluations import Reevaluations, RepeatOutcome
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.report.__main__ import elsewhere, table
from pga_me_ros.report.compared_run import ComparedRun
from pga_me_ros.report.comparison import compare
from pga_me_ros.report.comparison_table import comparison_table
from pga_me_ros.report.pictures import PIXELS, draw_archive, hatched

REPEATS = 4


def outcomes(run: StoredRun, less: float) -> list[RepeatOutcome]:
    """Return re-evaluations of all elites: less fit, at other descriptors, every other one a fall."""
    return [
        RepeatOutcome(
            elite.evaluation, k, elite.fitness - less, elite.descriptor / 2, 5, bool(k % 2)
        )
        for elite in run.archive.elites()
        for k in range(REPEATS)
    ]


@pytest.fixture
def again(hopper_run: Path, tmp_path: Path) -> StoredRun:
    """The run after all of its elites were re-evaluated, in its own world and in another one."""
    folder = Path(shutil.copytree(hopper_run, tmp_path / "again"))
    run = StoredRun.load(folder)
    rows = Reevaluations.none(run.info.run_id, 1).with_more(outcomes(run, 3.0))
    assert run.corrected is None
    rows.save(run.file)
    measured = StoredRun.load(folder).corrected
    assert isinstance(measured, CorrectedMetrics)
    rows.with_measure(run.metrics[-1].generation, measured).save(run.file)
    other = Reevaluations.none(run.info.run_id, 1, "friction 0.3 0.6")
    other.with_more(outcomes(run, 7.0)).save(run.file)
    return StoredRun.load(folder)


def test_the_table_has_corrected_columns_where_there_are_some(
    again: StoredRun, hopper_run: Path
) -> None:
    m = again.corrected
    assert m is not None
    lines = table([again, StoredRun.load(hopper_run)]).splitlines()
    assert lines[0].endswith("| fitness difference | descriptor error | falls |")
    cells = [cell.strip() for cell in lines[2].strip("|").split("|")]
    numbers = [f"{m.repeats}", f"{m.coverage}", f"{m.qd_score:,.0f}", f"{m.max_fitness:,.0f}"]
    assert cells[7:] == [*numbers, "3", f"{m.descriptor_error:.3f}", "50.0%"]
    assert lines[3].endswith("| - | - | - | - | - | - | - |")
    median = [cell.strip() for cell in lines[4].strip("|").split("|")]
    assert median[7:] == cells[7:], "a run without measures has no part in their medians"
    assert "Flageat & Cully 2023" in lines[-1]
    assert "corrected" not in table([StoredRun.load(hopper_run)])


def test_what_survives_in_another_world_has_a_table_of_its_own(again: StoredRun) -> None:
    lines = list(elsewhere([again]))
    assert len(lines) == 4
    assert "| friction 0.3 0.6 | 4 |" in lines[-1]
    assert lines[-1].endswith("| 50.0% |")
    best = again.archive.max_fitness - 7.0
    assert f"| {best:,.0f} |" in lines[-1]


def test_the_archive_is_drawn_corrected_unless_asked_otherwise(
    again: StoredRun, tmp_path: Path
) -> None:
    drawings = {}
    for single in (False, True):
        folder = tmp_path / str(single)
        folder.mkdir()
        _, svg = draw_archive(again, folder, single=single)
        drawings[single] = svg.read_text()
    assert "corrected by the means of 4 re-evaluations" in drawings[False]
    assert "mean fitness (sum of rewards)" in drawings[False]
    assert "corrected" not in drawings[True]
    assert drawings[False] != drawings[True]


def test_what_falls_is_hatched(hopper_run: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(hopper_run, tmp_path / "again"))
    run = StoredRun.load(folder)
    fate = [
        dataclasses.replace(outcome, terminated=outcome.evaluation % 2 == 0)
        for outcome in outcomes(run, 3.0)
    ]
    Reevaluations.none(run.info.run_id, 1).with_more(fate).save(run.file)
    again = StoredRun.load(folder)
    archive = corrected_archive(again.archive, again.statistics)
    steady = steady_archive(again.archive, again.statistics, 0.5)
    owners = corrected_owners(again.archive, again.statistics)
    falls = again.statistics.fall_share[owners[archive.filled]] > 0.5
    assert 0 < np.count_nonzero(falls) < len(falls)
    assert list(steady.filled_cells()) == list(archive.filled_cells()[~falls])
    image = draw_heatmap(archive, PIXELS)
    picture = hatched(image, steady, archive)
    changed = (picture != image).any(axis=2)
    assert (picture[changed] == 255).all()
    shown = np.linspace(0.0, 1.0, PIXELS, endpoint=False) + 0.5 / PIXELS
    cells = archive.cell_of(shown[:, None])
    hatch = changed.any(axis=0)
    sure = [
        k
        for k in range(1, PIXELS - 1)
        if archive.filled[cells[k]] and cells[k - 1] == cells[k] == cells[k + 1]
    ]
    assert sure
    for k in sure:
        assert hatch[k] != steady.filled[cells[k]], "a pixel well inside a cell"


def test_a_comparison_has_corrected_columns_of_the_last_generation(again: StoredRun) -> None:
    run = ComparedRun.load(again.file)
    m = again.corrected
    assert m is not None
    assert run.is_corrected
    last = run.evaluations[-1:]
    assert run.at(last, "corrected_qd_score", 0.0).tolist() == [m.qd_score]
    assert run.at(last, "corrected_qd_score", -2.0).tolist() == [m.qd_score + 2.0 * m.coverage]
    assert np.isnan(run.at(run.evaluations[:1], "corrected_qd_score", 0.0)).all()
    text = comparison_table(compare([run]))
    assert "| corrected QD-score | p | corrected coverage | p | falls | p |" in text
    assert f"| {m.coverage:,} | - | 0.500 | - |" in text
    corrected = run.load_archive(corrected=True)
    assert corrected.coverage == m.coverage != again.archive.coverage
