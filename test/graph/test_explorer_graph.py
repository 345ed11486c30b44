"""The explorer's page on running graphs: what comes in, what it tells the run, and the requests that it hands out."""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from browsing import Page
from graph import Graph, Probe, Started
from pga_me_msgs import srv
from pga_me_msgs.msg import Behavior

from pga_me_ros.core.storage.stored_run import StoredRun

pytestmark = pytest.mark.slow


@pytest.fixture
def explore(graph: Graph, browser: Any) -> Iterator[Callable[..., tuple[Started, Page]]]:
    """Return a function that starts the explorer and opens its page."""
    opened: list[Page] = []

    def start(*words: str) -> tuple[Started, Page]:
        command = [sys.executable, "-m", "pga_me_ros.explorer", "--port", "0", *words]
        explorer = graph.launch(command)
        explorer.wait_for_output("http://")
        address = re.findall(r"http://\S+", explorer.output)[0]
        opened.append(Page(browser, address.replace("//0.0.0.0:", "//127.0.0.1:")))
        return explorer, opened[-1]

    yield start
    for page in opened:
        page.close()


def answered(page: Page, probe: Probe, button: str) -> Any:
    """Send the request that a button of the page copies, and return the answer."""
    page.page.click(button)
    copied = page.page.inner_text("#copied")
    name, kind, text = re.fullmatch(
        r'ros2 service call (\S+) pga_me_msgs/srv/(\S+) "(.*)"', copied
    ).groups()
    return probe.call(getattr(srv, kind), name, **yaml.safe_load(text))


def chosen(page: Page, probe: Probe) -> Behavior:
    """Return the answer to the request that the page copies for the chosen gait."""
    answer = answered(page, probe, "#copy-service")
    assert answer.found
    assert str(answer.behavior.cell) == page.figures()["cell"]
    return answer.behavior


def rows(page: Page) -> set[int]:
    """Return the cells in the page's table."""
    lines = page.page.locator("#table tr[data-row]")
    return set(lines.evaluate_all("(lines) => lines.map((line) => Number(line.dataset.row))"))


def test_a_run_is_watched_and_steered_beside_its_own_file(
    graph: Graph, probe: Probe, explore: Callable[..., tuple[Started, Page]], tmp_path: Path
) -> None:
    run = graph.run(
        tmp_path / "run",
        task="qd_hopper",
        algorithm="map_elites",
        evaluations=100_000,
        random_init=20,
        batch_size=20,
        serve=True,
    )
    run.wait_for_output("generation 4")
    explorer, page = explore(str(tmp_path / "run"), "--graph", "/")

    # The whole history is there, and generations come in.
    generations = "Explorer.state.runs[1].curves.generation"
    assert page.eval(f"{generations}.slice(0, 4)") == [0, 1, 2, 3]
    before = page.eval(f"{generations}.length")
    page.wait(f"{generations}.length > {before}")
    assert page.page.locator("#curves .key .swatch").count() == 2
    page.wait("document.getElementById('progress-1').innerText.includes('running')")
    page.wait("document.getElementById('control').innerText.includes('/evaluator_0')")

    # Pause pauses.
    page.page.click("#do-pause-1")
    page.wait("document.getElementById('progress-1').innerText.includes('paused')")

    # Rates: those that the algorithm has, within their ranges.
    page.page.click("#show-rates-1")
    page.wait("document.getElementById('rate-iso_sigma-1') !== null")
    assert page.page.locator("#rate-critic_learning_rate-1").count() == 0
    assert "from 0 to 100" in page.page.inner_text("label:has(#rate-iso_sigma-1)")
    page.page.fill("#rate-iso_sigma-1", "-1")
    assert page.eval("document.getElementById('rate-iso_sigma-1').validity.rangeUnderflow")
    page.page.fill("#rate-iso_sigma-1", "")
    assert page.eval("document.getElementById('rate-iso_sigma-1').validity.valueMissing")
    told = page.eval(
        """() => fetch('api/control/1', {method: 'POST', headers: {'X-Explorer': '1'},
            body: '{"action": "rates", "values": {"iso_sigma": -1}}'}).then((answer) => answer.json())"""
    )
    assert "iso_sigma out of range" in told["error"]
    page.problems.clear()  # the browser notes the status 400
    page.page.fill("#rate-iso_sigma-1", "0.01")
    page.page.click("#set-rates-1")
    page.wait("document.getElementById('said-1').innerText.includes('iso_sigma = 0.01')")
    page.wait("document.getElementById('rate-iso_sigma-1').defaultValue === '0.01'")
    run.wait_for_output("iso_sigma = 0.01")

    # Who comes from elsewhere needs a token and cannot control the run.
    _, guest = explore("--graph", "/", "--host", "0.0.0.0")
    guest.wait("document.getElementById('progress-0').innerText.includes('paused')")
    for name in ("do-pause", "do-resume", "do-stop", "show-rates"):
        assert guest.page.is_disabled(f"#{name}-0")
    assert "read-only" in guest.page.inner_text("#said-0")

    # What the graph tells then is what its file holds.
    stored = StoredRun.load(tmp_path / "run")
    paused_at = len(stored.generations)
    page.wait(f"Explorer.state.runs[0].curves.generation.length === {paused_at}")
    for part in ("curves", "contributions", "elites"):
        of = [f"JSON.stringify(Explorer.state.runs[{i}].{part})" for i in (0, 1)]
        page.wait(f"{of[0]} === {of[1]}", 90)

    # The copied request is answered with what the page shows, and the gait moves from any start.
    cell = stored.choose(best=True).cell
    page.page.locator(f'#maps figure:nth-child(2) path[data-cell="{cell}"]').click(force=True)
    found = chosen(page, probe)
    assert page.eval("Explorer.state.runs[1].byCell.get(Explorer.state.cell).fitness") == (
        found.fitness
    )
    page.page.fill("#world-seed", "7")
    page.page.fill("#world-ranges", "mass 0.8 1.2")
    page.page.click("#world-go")
    page.wait("Explorer.view().starts[0] === 'randomized:7:mass 0.8 1.2'")
    page.page.click("#pin")
    page.page.select_option("#start", "evaluation")
    page.wait("Explorer.view().starts.join() === 'evaluation,randomized:7:mass 0.8 1.2'")
    with page.page.expect_download() as download:
        page.page.click("#download-npz")
    with np.load(download.value.path()) as arrays:
        assert np.array_equal(arrays["parameters"][0], stored.behavior(cell).parameters)
    page.page.set_viewport_size({"width": 400, "height": 800})
    assert page.eval("document.documentElement.scrollWidth") == 400
    assert len(StoredRun.load(tmp_path / "run").generations) == paused_at
    assert page.eval(f"{generations}.length") == paused_at

    # The run goes on, and stops. A graph that is gone is no dead spinner.
    page.page.click("#do-resume-1")
    page.wait(f"{generations}.length > {paused_at}", 90)
    # A gait may have been replaced while it was asked for.
    told = "Failed to load resource: the server responded with a status of 400 (Bad Request)"
    assert set(page.problems + guest.problems) <= {told}
    page.page.click("#do-stop-1")
    assert run.wait() == 0
    for shown in (page, guest):
        shown.wait("document.getElementById('message').innerText.includes('does not answer')", 60)
        assert shown.eval("document.querySelectorAll('.cell.elite').length") > 0
    explorer.signal(signal.SIGINT)
    assert explorer.wait() == 0
    assert "Traceback" not in explorer.output


def test_two_graphs_are_compared(
    graph: Graph,
    probe: Probe,
    explore: Callable[..., tuple[Started, Page]],
    hopper_run: Path,
    new_run: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folders = [hopper_run, new_run(seed=6)]

    def serve(name: str, folder: Path) -> Started:
        return graph.start("archive_manager", {"repertoire": folder}, "-r", f"__ns:=/{name}")

    servers = [serve(name, folder) for name, folder in zip(("left", "right"), folders, strict=True)]
    _, page = explore("--graph", "/left", "--graph", "/right")
    left, right = (StoredRun.load(folder).archive for folder in folders)
    assert page.page.locator("#maps svg").count() == 3
    both = int((left.filled & right.filled).nonzero()[0][0])
    page.page.locator(f'#maps figure:nth-child(3) path[data-cell="{both}"]').hover(force=True)
    gap = float(page.page.inner_text("#tip").partition(": ")[2])
    assert gap == pytest.approx(left.fitness[both] - right.fitness[both], rel=2e-3, abs=0.05)
    page.page.locator(f'#maps figure:nth-child(2) path[data-cell="{both}"]').click(force=True)
    assert chosen(page, probe).fitness == right.fitness[both]
    page.page.click("#copy-python")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))
    names: dict[str, Any] = {"observation": np.zeros(15)}
    exec(page.page.inner_text("#copied"), names)
    rclpy.shutdown()
    assert names["behavior"].fitness == right.fitness[both]
    assert names["action"].shape == (3,)
    assert page.problems == []

    # What the filter copies chooses what the table has.
    page.page.fill("#filter-fitness", str(np.median(right.fitness[right.filled])))
    listed = answered(page, probe, "#filter-copy")
    assert {b.cell for b in listed.behaviors} == rows(page)
    assert 0 < len(rows(page)) < len(right)
    page.page.fill("#filter-descriptor", "0.4")
    page.page.fill("#filter-count", "3")
    nearest = answered(page, probe, "#filter-copy")
    assert {b.cell for b in nearest.behaviors} == rows(page)
    assert len(rows(page)) == 3

    # One that is gone is told, and found again.
    servers[1].signal(signal.SIGINT)
    page.wait("document.getElementById('message').innerText.includes('does not answer')", 60)
    serve("right", folders[1])
    page.wait("document.getElementById('message').hidden", 60)


def test_a_grid_of_a_task_that_is_unknown_here_has_a_map_and_a_reason(
    graph: Graph,
    explore: Callable[..., tuple[Started, Page]],
    new_run: Callable[..., Path],
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The file tells the bins of the grid; of a graph they follow from its gaits."""
    monkeypatch.syspath_prepend(tmp_path_factory.mktemp("task"))
    (Path(sys.path[0]) / "far_task.py").write_text(
        "import dataclasses\n"
        "from pga_me_ros.tasks.bullet.locomotion import QDWalker\n\n"
        "class Far(QDWalker):\n"
        '    spec = dataclasses.replace(QDWalker.spec, name="far", archive_bins=(6, 8))\n'
    )
    folder = new_run(task="far_task:Far", archive="grid", evaluations=30, random_init=30)
    graph.start("archive_manager", {"repertoire": folder})
    _, page = explore(str(folder), "--graph", "/")
    assert (
        page.page.locator("#maps svg").count() == 3
    )  # the difference, too: their cells are the same
    elites = len(StoredRun.load(folder).archive)
    for figure in (1, 2):
        shapes = page.page.locator(f"#maps figure:nth-child({figure}) path[data-cell]")
        assert shapes.count() == 48
        assert shapes.locator("xpath=self::*[contains(@class, 'elite')]").count() == elites
    assert "drawn as a grid of 6 x 8 bins" in page.page.inner_text("#summary")
    page.page.wait_for_selector("#no-stage:visible")
    assert "module 'far_task' does not load" in page.page.inner_text("#no-stage")
    assert page.page.is_hidden("#world")
    assert page.problems == []


def test_a_graph_that_serves_nothing_is_told(graph: Graph) -> None:
    explorer = graph.launch([sys.executable, "-m", "pga_me_ros.explorer", "--port", "0"])
    assert explorer.wait() == 2
    assert re.fullmatch(r"error: .*repertoire/get_info.*\n", explorer.output), explorer.output
