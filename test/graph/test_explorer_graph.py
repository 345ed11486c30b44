"""The explorer's page on a running graph: what comes in, what it tells the run, and the requests that it hands out."""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from browsing import Page, running_browser
from graph import Graph, Probe
from pga_me_msgs.srv import GetBehavior

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with running_browser() as running:
        yield running


def test_a_run_is_watched_and_steered(
    graph: Graph, probe: Probe, browser: Any, tmp_path: Path
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
    explorer = graph.launch([sys.executable, "-m", "pga_me_ros.explorer", "--port", "0"])
    explorer.wait_for_output("http://")
    address = re.findall(r"http://\S+", explorer.output)[0]
    page = Page(browser, address)
    try:
        page.wait("(Explorer.view().end > 0)")

        # Generations come in.
        evaluations = "Explorer.state.runs[0].curves.evaluations.at(-1)"
        page.wait(f"({evaluations} || 0) > 0")
        before = page.eval(evaluations)
        page.wait(f"{evaluations} > {before}")
        page.wait("document.getElementById('progress').innerText.includes('running')")
        page.wait("document.getElementById('control').innerText.includes('/evaluator_0')")

        # Rates.
        page.page.click("#show-rates")
        page.wait("document.getElementById('rate-iso_sigma') !== null")
        page.page.fill("#rate-iso_sigma", "0.01")
        page.page.click("#set-rates")
        page.wait("document.getElementById('said').innerText.includes('iso_sigma = 0.01')")
        page.wait("document.getElementById('rate-iso_sigma').defaultValue === '0.01'")
        run.wait_for_output("iso_sigma = 0.01")

        # Pause pauses.
        page.page.click("#do-pause")
        page.wait("document.getElementById('progress').innerText.includes('paused')")

        # The copied request is answered with what the page shows.
        page.page.click("#copy-service")
        copied = page.page.inner_text("#copied")
        name, kind, text = re.fullmatch(r'ros2 service call (\S+) (\S+) "(.*)"', copied).groups()
        assert (name, kind) == ("/repertoire/get_behavior", "pga_me_msgs/srv/GetBehavior")
        answer = probe.call(GetBehavior, name, **yaml.safe_load(text))
        assert answer.found
        assert str(answer.behavior.cell) == page.figures()["cell"]
        assert (
            page.eval("Explorer.state.runs[0].byCell.get(Explorer.state.cell).fitness")
            == answer.behavior.fitness
        )
        assert page.problems == []

        # A graph that is gone is no dead spinner.
        page.page.click("#do-resume")
        run.signal(signal.SIGINT)
        run.wait()
        page.wait("document.getElementById('message').innerText.includes('does not answer')", 60)
        assert page.eval("document.querySelectorAll('.cell.elite').length") > 0
        explorer.signal(signal.SIGINT)
        assert explorer.wait() == 0
        assert "Traceback" not in explorer.output
    finally:
        page.close()
