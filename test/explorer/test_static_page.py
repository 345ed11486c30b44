"""The page as one file, in a real browser that can reach nothing but that file."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from browsing import ZOO, Page, launched

from pga_me_ros.core.archive.color_range import color_range
from pga_me_ros.core.operators import OPERATORS, Operator
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.explorer.__main__ import main
from pga_me_ros.explorer.recorder import chosen_cells
from pga_me_ros.reevaluate.__main__ import main as reevaluate


def written(value: float) -> str:
    """Return a number as the page writes it."""
    if abs(value) >= 1000.0:
        return f"{value:,.0f}"
    return f"{value:.1f}" if abs(value) >= 100.0 else f"{float(f'{value:.4g}'):g}"


def rgb(color: str) -> list[int]:
    return [int(x) for x in re.findall(r"\d+", color)]


def percent(share: float) -> str:
    return f"{100 * share:.1f}".removesuffix(".0") + " %"


def test_the_best_gait_is_shown_first(page: Any, run: StoredRun, hopper_file: Path) -> None:
    page.open(hopper_file.as_uri())
    best = run.choose(best=True)
    assert page.figures()["cell"] == str(best.cell)
    assert f"{best.mean_fitness:,.0f}" in page.figures()["on average"]
    assert page.eval("document.querySelectorAll('.cell.elite').length") == len(run.archive)
    assert page.eval("document.querySelectorAll('.cell.empty').length") == run.archive.cells - len(
        run.archive
    )


def test_a_click_shows_the_figures_of_that_cell_and_its_moving_robot(
    page: Any, run: StoredRun
) -> None:
    cell = chosen_cells(run, 3)[-1]
    behavior = run.behavior(cell)
    page.page.locator(f'#maps path[data-cell="{cell}"]').hover(force=True)
    assert page.page.inner_text("#tip").splitlines() == [
        f"cell {cell}",
        f"descriptor [{behavior.mean_descriptor[0]:.3f}] on average",
        f"fitness {written(behavior.fitness)} when found",
        f"mean of {behavior.repeats}: {written(behavior.mean_fitness)} ± {written(behavior.fitness_spread)}, "
        f"falls {percent(behavior.fall_share)}",
        f"{OPERATORS[Operator[behavior.made_by.upper()]].title}, generation {behavior.generation}, "
        f"parents {', '.join(map(str, behavior.parents)) or 'none'}",
    ]
    empty = int((~run.archive.filled).nonzero()[0][0])
    page.page.locator(f'#maps path[data-cell="{empty}"]').hover(force=True)
    assert page.page.inner_text("#tip") == f"cell {empty}: empty"
    page.choose(cell)
    page.plays(cell)
    figures = page.figures()
    assert figures["falls"] == percent(behavior.fall_share)
    assert f"{behavior.descriptor[0]:.3f}" in figures["descriptor"]
    assert (
        f"evaluation {behavior.evaluation}, generation {behavior.generation}" in figures["lineage"]
    )
    mark, bar = (
        page.page.locator(f"#maps path{which}").bounding_box()
        for which in (".chosen", f'[data-cell="{cell}"]')
    )
    assert mark["x"] + mark["width"] / 2 == pytest.approx(bar["x"] + bar["width"] / 2, abs=0.5)
    page.eval("Explorer.seek(0.5)")
    before = page.picture()
    assert page.picture() == before
    page.eval("Explorer.seek(0.8)")
    assert page.picture() != before


@pytest.mark.parametrize("seed", range(4))
def test_the_color_scale_is_that_of_the_heatmap(page: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=int(rng.integers(1, 120)))
    for outliers in ([], [1e3], [1e3, -1e3, -2e3]):
        given = [*values.tolist(), *outliers]
        found = page.eval("(values) => Colors.range(values)", given)
        assert found == list(color_range(np.array(given)))


def test_colors_switch_with_their_legend(page: Any) -> None:
    colors = set()
    for name, word in (
        ("falls", "share of falls"),
        ("generation", "generation"),
        ("operator", "PG"),
        ("spread", "spread"),
        ("fitness", "fitness"),
    ):
        page.page.select_option("#color", name)
        assert word in page.page.inner_text("#legend")
        colors.add(page.eval("document.querySelector('.cell.elite').style.fill"))
    assert len(colors) > 2


def test_the_filter_narrows_map_and_table(page: Any, run: StoredRun) -> None:
    page.page.fill("#filter-falls", "0")
    page.page.fill("#filter-fitness", "1500")
    known = run.statistics
    expected = int(((known.fall_share <= 0.0) & (known.mean_fitness >= 1500.0)).sum())
    assert page.page.inner_text("#matches") == f"{expected} of {len(run.archive)} gaits"
    assert page.eval("document.querySelectorAll('.cell.out').length") == len(run.archive) - expected
    page.page.fill("#filter-fitness", "many")
    assert "the fitness is 'many'; give a number" in page.page.inner_text("#matches")
    page.page.click("#filter-reset")
    page.wait("document.querySelectorAll('.cell.out').length === 0")


def test_a_choice_that_no_request_makes_is_not_copied(page: Any) -> None:
    page.page.select_option("#filter-operator", "ga")
    page.page.click("#filter-copy")
    assert "no request chooses by operator" in page.page.inner_text("#copied")
    page.page.click("#filter-reset")
    page.page.fill("#filter-fitness", "many")
    page.page.click("#filter-copy")
    assert page.page.inner_text("#copied") == "Not copied: the fitness is 'many'; give a number."
    page.page.click("#filter-reset")
    page.wait("document.querySelectorAll('.cell.out').length === 0")
    of_all = "{descriptor: null, fitness: null, falls: null}"
    copied = page.eval(f"Commands.nearest(Store.run(), {of_all}, 150)")
    assert copied.endswith('pga_me_msgs/srv/ListBehaviors "{limit: 150}"')  # 100 without it


def test_the_nearest_are_those_that_the_library_chooses(page: Any, run: StoredRun) -> None:
    page.page.fill("#filter-descriptor", "0.7")
    page.page.fill("#filter-count", "4")
    rows = page.eval(
        "[...document.querySelectorAll('#table tr[data-row]')].map((r) => Number(r.dataset.row))"
    )
    assert set(rows) == set(run.choices().nearest([0.7], 4)[0].tolist())
    page.page.click("#filter-copy")
    assert page.page.inner_text("#copied").endswith(
        '"{descriptor: [0.7], count: 4, with_controllers: false}"'
    )
    page.page.click("#filter-reset")


@pytest.mark.parametrize("name", ["zoo/qd_hopper", "run #2", "gait: é", "it's", "on"])
def test_the_command_that_serves_it_says_its_name_to_shell_and_yaml(page: Any, name: str) -> None:
    command = page.eval(f"Commands.server({{run: {{name: {json.dumps(name)}}}}})")
    parameter, _, value = shlex.split(command)[-1].partition(":=")
    assert (parameter, yaml.safe_load(value)) == ("repertoire", name)


def test_the_table_sorts(page: Any, run: StoredRun) -> None:
    page.page.click("#sort-cell")
    page.page.click("#sort-cell")
    first = page.page.locator("#table tr[data-row]").first.get_attribute("data-row")
    assert int(first) == run.archive.filled_cells()[0]
    assert page.eval("document.querySelector('th[aria-sort=ascending]').innerText").startswith(
        "cell"
    )
    page.page.click("#sort-promise")


def test_a_link_opens_the_same_gait_again(
    page: Any, pages: Callable[..., Any], run: StoredRun
) -> None:
    page.choose(chosen_cells(run, 3)[1])
    page.page.click("#copy-link")
    link = page.page.inner_text("#copied")
    again = pages(link, offline=True)
    assert again.figures() == page.figures()
    again.open(link.replace(f"cell={chosen_cells(run, 3)[1]}", "cell=99999"))
    again.wait("!document.getElementById('message').hidden")
    assert "Cell 99999" in again.page.inner_text("#message")


def test_it_works_by_keyboard_alone(page: Any, run: StoredRun) -> None:
    keys = page.page.keyboard

    def tab_to(is_there: str) -> None:
        for _ in range(30):
            if page.eval(is_there):
                return
            keys.press("Tab")
        raise AssertionError(f"Tab has not led to: {is_there}")

    page.page.locator("#skip").focus()
    tab_to("document.activeElement.tagName.toLowerCase() === 'svg'")
    keys.press("ArrowRight")
    right = int(page.figures()["cell"])
    keys.press("ArrowLeft")
    left = int(page.figures()["cell"])
    where = {cell: run.archive.centroids[cell][0] for cell in (left, right)}
    assert where[left] < where[right]
    recorded = chosen_cells(run, 3)
    for _ in range(200):  # to a gait that the file has in motion
        if int(page.figures()["cell"]) in recorded:
            break
        keys.press("ArrowRight" if where[left] < 0.5 else "ArrowLeft")
    page.plays(int(page.figures()["cell"]))
    tab_to("document.activeElement.id === 'play'")
    keys.press("Space")
    page.wait("Explorer.view().time > 0.1")
    keys.press("Space")
    assert page.eval("Explorer.view().playing") is False
    tab_to("document.activeElement.id === 'copy-service'")
    keys.press("Enter")
    assert page.page.inner_text("#copied").startswith("ros2 service call")
    tab_to("document.activeElement.closest('tr[data-row]') !== null")
    row = page.eval("document.activeElement.closest('tr').dataset.row")
    keys.press("Enter")
    assert page.figures()["cell"] == row


def test_nothing_is_wider_than_a_phone(page: Any) -> None:
    before = page.page.viewport_size
    page.page.set_viewport_size({"width": 400, "height": 800})
    for scheme in ("dark", "light"):
        page.page.emulate_media(color_scheme=scheme)
        page.wait(f"document.documentElement.dataset.theme === '{scheme}'")
        assert page.eval("document.documentElement.scrollWidth") == 400
    assert page.page.is_hidden("#layout-label")  # one dimension is drawn in one way
    page.page.set_viewport_size(before)


def test_a_task_without_a_robot_has_a_map_and_a_reason(
    new_run: Callable[..., Path],
    pages: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "core"))
    folder = new_run(task="lane_task:Lane")
    out = tmp_path / "lane.html"
    assert main([str(folder), "--html", str(out)]) == 0
    shown = pages(out, offline=True)
    shown.page.wait_for_selector("#no-stage:visible")
    assert "has no property 'body'" in shown.page.inner_text("#no-stage")
    assert shown.eval("document.querySelectorAll('.cell.elite').length") == len(
        StoredRun.load(folder).archive
    )
    assert shown.problems == []


def test_two_runs_are_compared_cell_by_cell(
    hopper_run: Path, other_run: Path, pages: Callable[..., Any], tmp_path: Path
) -> None:
    folders = [hopper_run, other_run]
    first, second = (StoredRun.load(folder).archive for folder in folders)
    out = tmp_path / "two.html"
    assert main([*map(str, folders), "--html", str(out), "--motions", "1"]) == 0
    shown = pages(out, offline=True)
    assert shown.page.locator("#maps svg").count() == 3
    both = int((first.filled & second.filled).nonzero()[0][0])
    shown.page.locator(f'#maps figure:nth-child(3) path[data-cell="{both}"]').hover(force=True)
    gap = float(first.fitness[both] - second.fitness[both])
    told = float(shown.page.inner_text("#tip").partition(": ")[2])
    same = shown.eval(f"Colors.difference(Store.run(), Store.run()).color({both})")
    for scheme in ("dark", "light"):
        shown.page.emulate_media(color_scheme=scheme)
        shown.wait(f"document.documentElement.dataset.theme === '{scheme}'")
        empty = shown.eval("getComputedStyle(document.querySelector('#maps .cell.empty')).fill")
        apart = np.array(rgb(same)) - rgb(empty)
        assert np.abs(apart).max() > 40, "no difference looks like an empty cell"
    assert told == pytest.approx(gap, rel=2e-3, abs=0.05)
    shown.page.locator(f'#maps figure:nth-child(2) path[data-cell="{both}"]').click(force=True)
    assert shown.eval("Explorer.state.run") == 1
    assert f"evaluation {second.evaluations[both]}," in shown.figures()["lineage"]
    assert shown.problems == []


def test_runs_with_other_cells_have_no_difference_and_say_so(
    hopper_run: Path, pages: Callable[..., Any], tmp_path: Path
) -> None:
    out = tmp_path / "two.html"
    assert main([str(hopper_run), ZOO, "--html", str(out), "--motions", "0"]) == 0
    shown = pages(out, offline=True)
    assert shown.page.locator("#maps svg").count() == 2
    assert "the cells of the two runs are not the same" in shown.page.inner_text("#maps")
    assert shown.problems == []


def test_curves_have_a_circle_where_the_archive_was_measured(
    longer_run: Path, pages: Callable[..., Any], tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(longer_run, folder)
    assert reevaluate([str(folder), "--repeats", "2"]) == 0
    out = tmp_path / "curves.html"
    assert main([str(folder), "--html", str(out), "--motions", "0"]) == 0
    page = pages(out, offline=True)
    assert page.page.locator("#curves svg").count() == 3
    assert page.page.locator("#curves circle").count() == 3
    corrected = StoredRun.load(folder).corrected
    assert corrected is not None
    assert f"corrected QD-score\t{written(corrected.qd_score)}" in page.page.inner_text("#facts")
    assert page.problems == []


def test_cells_are_drawn_where_the_archive_has_them(
    new_run: Callable[..., Path], pages: Callable[..., Any], tmp_path: Path
) -> None:
    folder = new_run(task="qd_walker")
    archive = StoredRun.load(folder).archive
    out = tmp_path / "walker.html"
    assert main([str(folder), "--html", str(out), "--motions", "0"]) == 0
    shown = pages(out, offline=True)
    points = np.random.default_rng(0).random((60, 2))
    cells = shown.eval(
        """(points) => {
            const svg = document.querySelector('#maps svg');
            const frame = svg.querySelector('rect.frame');
            const [x, y, w, h] = ['x', 'y', 'width', 'height'].map((n) => Number(frame.getAttribute(n)));
            const paths = [...svg.querySelectorAll('path[data-cell]')];
            return points.map(([u, v]) => {
                const point = new DOMPoint(x + u * w, y + (1 - v) * h);
                return Number(paths.find((p) => p.isPointInFill(point)).dataset.cell);
            });
        }""",
        points.tolist(),
    )
    assert cells == archive.cell_of(points).tolist()


def test_four_dimensions_are_maps_within_maps_or_any_two_axes(
    new_run: Callable[..., Path], pages: Callable[..., Any], tmp_path: Path
) -> None:
    folder = new_run(task="qd_ant", evaluations=4, random_init=4, batch_size=4, n_evo=4)
    archive = StoredRun.load(folder).archive
    out = tmp_path / "ant.html"
    assert main([str(folder), "--html", str(out), "--motions", "0"]) == 0
    shown = pages(out, offline=True)
    assert 0 < shown.eval("document.querySelectorAll('path.cell.elite').length") <= len(archive)
    shown.page.set_viewport_size({"width": 400, "height": 800})
    assert shown.eval("document.documentElement.scrollWidth") == 400
    outside = shown.page.locator("#maps text").evaluate_all(
        """(texts) => texts.filter((text) => {
            const [own, all] = [text, text.ownerSVGElement].map((e) => e.getBoundingClientRect());
            return own.left < all.left || own.right > all.right || own.top < all.top || own.bottom > all.bottom;
        }).map((text) => text.textContent)"""
    )
    assert outside == []
    shown.page.select_option("#layout", "dots:1,3")
    assert shown.eval("document.querySelectorAll('circle.cell.elite').length") == len(archive)
    assert shown.problems == []


def test_a_task_that_is_unknown_here_has_a_map_and_a_reason(
    new_run: Callable[..., Path],
    pages: Callable[..., Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = new_run(task="lane_task:Lane")
    monkeypatch.delitem(sys.modules, "lane_task")
    monkeypatch.setattr(sys, "path", [p for p in sys.path if not p.endswith("test/core")])
    out = tmp_path / "lane.html"
    assert main([str(folder), "--html", str(out)]) == 0
    reason = "task 'lane_task:Lane': module 'lane_task' does not load"
    assert f"has no 3-D view: {reason}" in capsys.readouterr().err
    shown = pages(out, offline=True)
    shown.page.wait_for_selector("#no-stage:visible")
    assert f"No 3-D view: {reason}" in shown.page.inner_text("#no-stage")
    assert shown.eval("document.querySelectorAll('.cell.elite').length") == len(
        StoredRun.load(folder).archive
    )
    assert shown.problems == []


def test_without_webgl_there_is_the_rest_and_a_reason(browser: Any, hopper_file: Path) -> None:
    with launched(browser.browser_type, "--disable-3d-apis") as other:
        page = Page(other, hopper_file.as_uri())
        assert "This browser cannot draw 3-D (WebGL)" in page.page.inner_text("#no-stage")
        cells = page.page.locator("#maps path.elite")
        cells.first.click(force=True)
        assert page.figures()["cell"] == cells.first.get_attribute("data-cell")
        page.close()
