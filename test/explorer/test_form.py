"""The form that chooses gaits: what was typed stays, what it offers is up to date, what no request takes is told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest


@pytest.fixture(scope="module")
def beside(page_of_two: Callable[[int], Any]) -> Any:
    """Return the page of two runs."""
    return page_of_two(0)


@pytest.fixture
def page(beside: Any) -> Any:
    """Return it with an empty form."""
    beside.page.click("#filter-reset")
    beside.wait("Store.state.matching === null")
    return beside


def operators(page: Any) -> list[str]:
    found: list[str] = page.eval(
        "[...document.getElementById('filter-operator').options].map((o) => o.value)"
    )
    return found


@pytest.mark.parametrize(
    ("name", "texts", "why"),
    [
        ("falls", ["-5", "150 %", "100.1"], "the share of falls must be from 0 to 100 %"),
        ("count", ["0", "1001", "2.5"], "the count must be a whole number from 1 to 1000"),
    ],
)
def test_what_no_request_takes_is_told_and_not_copied(
    page: Any, name: str, texts: list[str], why: str
) -> None:
    for text in texts:
        page.page.fill(f"#filter-{name}", text)
        assert page.page.inner_text("#matches") == f"{why}."
        page.page.click("#filter-copy")
        assert page.page.inner_text("#copied") == f"Not copied: {why}."


def test_limits_stay_when_a_gait_of_the_other_run_is_chosen(page: Any) -> None:
    fields = {"descriptor": "0.4", "count": "3", "fitness": "-10", "falls": "100"}
    for name, text in fields.items():
        page.page.fill(f"#filter-{name}", text)
    other = 1 - page.eval("Explorer.state.run")
    page.page.locator(f"#maps figure:nth-child({1 + other}) path.elite").first.click(force=True)
    assert page.eval("Explorer.state.run") == other
    assert {name: page.page.input_value(f"#filter-{name}") for name in fields} == fields


def test_operators_are_those_of_the_gaits_and_the_chosen_one(page: Any) -> None:
    make = (
        "(name) => { const { runs, run } = Explorer.state; runs[run].elites[0].made_by = name; "
        "Store.set({ runs: [...runs] }); }"
    )
    first = page.eval("Store.run().elites[0].made_by")
    before = operators(page)
    page.eval(make, "pg")
    assert operators(page) == sorted({*before, "pg"})
    page.page.select_option("#filter-operator", "pg")
    page.eval(make, first)
    assert page.page.input_value("#filter-operator") == "pg"
    assert page.page.inner_text("#matches").startswith("0 of")
    page.page.click("#filter-reset")
    page.wait("document.getElementById('filter-operator').value === ''")
    page.eval(make, first)
    assert operators(page) == before
