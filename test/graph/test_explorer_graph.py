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
from browsing import Page, running_browser
from graph import Graph, Probe, Started
from pga_me_msgs.srv import GetBehavior

from pga_me_ros.core.storage.stored_run import StoredRun

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with running_browser() as running:
        yield running


@pytest.fixture
def explore(graph: Graph, browser: Any) -> Iterator[Callable[..., tuple[Started, Page]]]:
    """Return a function that starts the explorer and opens its page."""
    opened: list[Page] = []

    def start(*words: str) -> tuple[Started, Page]:
        command = [sys.executable, "-m", "pga_me_ros.explorer", "--port", "0", *words]
        explorer = graph.launch(command)
        explorer.wait_for_output("http://")
        opened.append(Page(browser, re.findall(r"http://\S+", explorer.output)[0]))
        return explorer, opened[-1]

    yield start
    for page in opened:
        page.close()


def answered(page: Page, probe: Probe) -> GetBehavior.Response:
    """Send the request that the page copies for the chosen gait, and return the answer."""
    page.page.click("#copy-service")
    copied = page.page.inner_text("#copied")
    name, kind, text = re.fullmatch(r'ros2 service call (\S+) (\S+) "(.*)"', copied).groups()
    assert kind == "pga_me_msgs/srv/GetBehavior"
    answer = probe.call(GetBehavior, name, **yaml.safe_load(text))
    assert answer.found
    assert str(answer.behavior.cell) == page.figures()["cell"]
    return answer


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
    page.wait("document.getElementById('progress-1').innerText.includes('running')")
    page.wait("document.getElementById('control').innerText.includes('/evaluator_0')")

    # Rates.
    page.page.click("#show-rates-1")
    page.wait("document.getElementById('rate-iso_sigma-1') !== null")
    page.page.fill("#rate-iso_sigma-1", "0.01")
    page.page.click("#set-rates-1")
    page.wait("document.getElementById('said-1').innerText.includes('iso_sigma = 0.01')")
    page.wait("document.getElementById('rate-iso_sigma-1').defaultValue === '0.01'")
    run.wait_for_output("iso_sigma = 0.01")

    # Pause pauses; what the graph tells then is what its file holds.
    page.page.click("#do-pause-1")
    page.wait("document.getElementById('progress-1').innerText.includes('paused')")
    for part in ("curves", "contributions", "elites"):
        of = [f"JSON.stringify(Explorer.state.runs[{i}].{part})" for i in (0, 1)]
        page.wait(f"{of[0]} === {of[1]}")

    # The copied request is answered with what the page shows, and the gait moves from any start.
    cell = StoredRun.load(tmp_path / "run").choose(best=True).cell
    page.page.locator(f'#maps figure:nth-child(2) path[data-cell="{cell}"]').click(force=True)
    found = answered(page, probe).behavior
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
    assert page.problems == []

    # A graph that is gone is no dead spinner.
    page.page.click("#do-resume-1")
    run.signal(signal.SIGINT)
    run.wait()
    page.wait("document.getElementById('message').innerText.includes('does not answer')", 60)
    assert page.eval("document.querySelectorAll('.cell.elite').length") > 0
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
    assert answered(page, probe).behavior.fitness == right.fitness[both]
    page.page.click("#copy-python")
    monkeypatch.setenv("ROS_DOMAIN_ID", str(graph.domain))
    names: dict[str, Any] = {"observation": np.zeros(15)}
    exec(page.page.inner_text("#copied"), names)
    rclpy.shutdown()
    assert names["behavior"].fitness == right.fitness[both]
    assert names["action"].shape == (3,)
    assert page.problems == []

    # One that is gone is told, and found again.
    servers[1].signal(signal.SIGINT)
    page.wait("document.getElementById('message').innerText.includes('does not answer')", 60)
    serve("right", folders[1])
    page.wait("document.getElementById('message').hidden", 60)
