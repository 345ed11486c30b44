"""What the page looks like: nothing that it draws says anything that is not so, in light and dark."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsing import ZOO

from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.explorer.recorder import chosen_cells

SCHEMES = ("light", "dark")


@pytest.fixture(scope="module")
def recorded() -> list[int]:
    """Return the cells whose gaits `hopper_page` has in motion."""
    return chosen_cells(StoredRun.load(ZOO), 3)


@pytest.fixture(scope="module")
def two(page_of_two: Callable[[int], Any]) -> Any:
    """Return a page of two runs whose gaits last for different times."""
    return page_of_two(3)


def in_scheme(page: Any, scheme: str) -> None:
    page.page.emulate_media(color_scheme=scheme)
    page.wait(f"document.documentElement.dataset.theme === '{scheme}'")


def choose(page: Any, cell: int) -> None:
    page.choose(cell)
    page.plays(cell)


def numbers(color: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([float(x) for x in color.strip("rgb()").split(",")])


def strip_pixels(page: Any) -> list[list[int]]:
    """Return the colors of a row of pixels of the strip chart, as red, green, blue and opacity."""
    pixels: list[list[int]] = page.eval(
        """() => {
            const strip = document.getElementById('strip');
            const copy = new OffscreenCanvas(strip.width, 1).getContext('2d', { willReadFrequently: true });
            copy.drawImage(strip, 0, -4);
            const { data } = copy.getImageData(0, 0, strip.width, 1);
            return [...Array(strip.width).keys()].map((i) => [...data.slice(4 * i, 4 * i + 4)]);
        }"""
    )
    return pixels


@pytest.mark.parametrize("scheme", SCHEMES)
def test_no_gait_has_the_color_of_an_empty_cell(page: Any, scheme: str) -> None:
    in_scheme(page, scheme)
    empty = numbers(page.eval("getComputedStyle(document.querySelector('.cell.empty')).fill"))
    for name in ("fitness", "falls", "spread", "generation", "operator"):
        page.page.select_option("#color", name)
        found = page.eval(
            "[...document.querySelectorAll('.cell.elite')].map((e) => getComputedStyle(e).fill)"
        )
        assert min(np.abs(numbers(color) - empty).max() for color in found) > 60
    # The legend has the colors of the map, and ends that no gait of this run has are told apart as well.
    for name in ("fitness", "falls"):
        page.page.select_option("#color", name)
        low, *_, high = page.eval(
            "getComputedStyle(document.querySelector('#legend .ramp')).backgroundImage.match(/rgb\\([^)]*\\)/g)"
        )
        assert np.abs(numbers(low) - empty).max() > 60
        assert np.abs(numbers(high) - empty).max() > 60
    page.page.select_option("#color", "fitness")


def test_the_strip_takes_the_colors_of_the_page(page: Any, recorded: list[int]) -> None:
    choose(page, recorded[0])
    for scheme in SCHEMES:
        in_scheme(page, scheme)
        empty = page.eval("Page.color('empty')")
        back = [*bytes.fromhex(empty.removeprefix("#")), 255]
        assert back in strip_pixels(page)


def test_a_gait_without_motion_leaves_no_other_robot_on_the_stage(
    page: Any, recorded: list[int]
) -> None:
    run = StoredRun.load(ZOO)
    choose(page, recorded[0])
    with_robot = page.picture()
    other = next(c for c in run.archive.filled_cells().tolist() if c not in recorded)
    page.choose(other)
    page.page.wait_for_selector("#no-stage:visible")
    assert page.picture() != with_robot


def test_robots_that_are_compared_have_the_numbers_of_their_list(
    page: Any, recorded: list[int]
) -> None:
    choose(page, recorded[0])
    assert "1:" not in page.page.inner_text("#lanes")
    page.page.click("#pin")
    page.choose(recorded[1])
    page.wait("Explorer.view().cells.length === 2")
    listed = page.page.inner_text("#lanes")
    assert f"1: cell {recorded[1]} " in listed
    assert f"✕ 2: cell {recorded[0]} " in listed
    page.page.click("#lanes button:has-text('✕')")
    page.wait("Explorer.view().cells.length === 1")


def test_keys_turn_the_camera(page: Any, recorded: list[int]) -> None:
    choose(page, recorded[0])
    page.page.focus("#stage")
    seen = [page.picture()]
    for key in ("ArrowRight", "ArrowUp", "+"):
        page.page.keyboard.press(key)
        seen.append(page.picture())
    assert len(set(seen)) == len(seen)


def test_what_is_copied_stands_below_its_button(page: Any, recorded: list[int]) -> None:
    choose(page, recorded[0])
    page.page.click("#filter-copy")
    assert "list_behaviors" in page.page.inner_text("#choose #copied")
    page.page.click("#copy-service")
    assert "get_behavior" in page.page.inner_text("#details #copied")


def test_two_runs_have_bars_of_one_scale(two: Any, hopper_run: Path, other_run: Path) -> None:
    first, second = (StoredRun.load(folder).archive for folder in (hopper_run, other_run))
    most = max(archive.fitness[archive.filled].max() for archive in (first, second))
    figures = two.page.locator("#maps figure")
    frame = float(figures.first.locator("rect.frame").get_attribute("height"))

    def height(figure: int, cell: int) -> float:
        path = figures.nth(figure).locator(f'path[data-cell="{cell}"]')
        return float(path.evaluate("(e) => e.getBBox().height")) / frame

    for figure, archive in enumerate((first, second)):
        for cell in archive.filled_cells().tolist():
            assert height(figure, cell) == pytest.approx(archive.fitness[cell] / most, abs=0.02)
    # In the map of the difference, what only the second has is as high as that.
    for cell in (second.filled & ~first.filled).nonzero()[0].tolist():
        assert height(2, cell) == pytest.approx(second.fitness[cell] / most, abs=0.02)
    assert two.problems == []


def test_the_strip_spans_what_the_slider_spans(two: Any) -> None:
    two.wait("Explorer.view().cells.length === 1")
    two.page.click("#pin")
    cells = two.eval("Explorer.state.runs.map((run) => Object.keys(run.motions).map(Number))")
    ends = {}
    for run, of_run in enumerate(cells):
        for cell in of_run:
            two.eval(f"Store.set({{ run: {run}, cell: {cell} }})")
            two.plays(cell)
            ends[run, cell] = two.eval(
                f"Motions.find(Explorer.state.runs[{run}], {cell}, 'evaluation').then((m) => m.end)"
            )
    (run, cell), shorter = min(ends.items(), key=lambda item: item[1])
    two.eval(f"Store.set({{ run: {run}, cell: {cell} }})")
    two.wait(f"Explorer.view().cells[0] === {cell} && Explorer.view().cells.length === 2")
    end = two.eval("Explorer.view().end")
    assert end > 1.05 * shorter
    two.page.click("#strip")  # in its middle
    assert two.eval("Explorer.view().time") == pytest.approx(end / 2, rel=0.01)
    pixels = strip_pixels(two)
    drawn = max(i for i, (*_, opacity) in enumerate(pixels) if opacity) / len(pixels)
    assert drawn == pytest.approx(max(shorter / end, 0.5), abs=0.02)
    assert two.problems == []
