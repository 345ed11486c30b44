"""Two runs beside each other: what they are compared by, and what is said where they cannot be."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pga_me_ros.core.storage.distinct import require_distinct
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError
from pga_me_ros.explorer.graph_source import open_graphs


@pytest.fixture(scope="module")
def beside(page_of_two: Callable[[int], Any]) -> Any:
    """Return the page of two runs that have the same cells."""
    return page_of_two(0)


def test_a_run_is_given_once(hopper_run: Path, other_run: Path) -> None:
    runs = [StoredRun.load(folder) for folder in (hopper_run, other_run)]
    require_distinct(runs)
    with pytest.raises(RequestError, match="is the same run as"):
        require_distinct([*runs, StoredRun.load(hopper_run)])


def test_a_graph_is_given_once() -> None:
    with pytest.raises(RequestError, match="a namespace twice"):
        open_graphs(["/a", "/a"], [])


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ("spec.name = 'hound'", "the two runs are of different tasks"),
        ("spec.descriptor_names = ['height']", "the descriptors of the two runs are not the same"),
    ],
)
def test_runs_with_the_same_cells_but_of_other_things_have_no_difference(
    beside: Any, change: str, why: str
) -> None:
    place = change.partition(" = ")[0]
    before = beside.eval(f"JSON.stringify(Explorer.state.runs[1].{place})")
    assert beside.page.locator("#maps svg").count() == 3
    beside.eval(f"(Explorer.state.runs[1].{change}, Maps.drawAll())")
    assert beside.page.locator("#maps svg").count() == 2
    assert why in beside.page.inner_text("#maps")
    beside.eval(f"(Explorer.state.runs[1].{place} = {before}, Maps.drawAll())")


def test_a_difference_of_means_and_single_evaluations_is_told(beside: Any) -> None:
    assert "mean of re-evaluations" not in beside.page.inner_text("#maps")
    both = beside.eval("Colors.difference(...Explorer.state.runs).gaps.size")
    beside.eval("(Explorer.state.runs[0].elites.forEach((e) => (e.judged = true)), Maps.drawAll())")
    told = beside.page.inner_text("#maps")
    assert f"In {both} of {both} cells of the difference, only one run has a mean" in told
