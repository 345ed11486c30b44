"""The live page of a repertoire on disk: a real server, a real browser, files that change under both."""

from __future__ import annotations

import io
import shutil
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from serving import Server, replace, running, started

from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.explorer.__main__ import main
from pga_me_ros.explorer.live import access_for
from pga_me_ros.explorer.server import Server as ExplorerServer
from pga_me_ros.explorer.source import StoredSource
from pga_me_ros.player.watched_rollout import record
from pga_me_ros.tasks.registry import make_task


@pytest.fixture(scope="module")
def folder(hopper_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of a run that the tests may change."""
    copy = tmp_path_factory.mktemp("live") / "run"
    shutil.copytree(hopper_run, copy)
    return copy


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[Server]:
    server = started(str(folder))
    yield server
    server.process.kill()
    server.process.communicate()


@pytest.fixture(scope="module")
def page(server: Server, pages: Callable[..., Any]) -> Any:
    return pages(server.address)


@pytest.mark.parametrize(
    ("start", "randomization", "damage"),
    [
        ("evaluation", "", ""),
        ("unseen:7", "", ""),
        ("randomized:7:mass 2.0, friction 0.5", "mass 2.0, friction 0.5", ""),
        ("damaged:7::weak leg_joint 0.2", "", "weak leg_joint 0.2"),
        ("damaged:7:mass 2.0:load 3, ice 0.5", "mass 2.0", "load 3, ice 0.5"),
    ],
    ids=["evaluation", "unseen", "randomized", "damaged", "damaged and randomized"],
)
def test_the_server_simulates_what_the_page_asks_for(
    page: Any, folder: Path, start: str, randomization: str, damage: str
) -> None:
    run = StoredRun.load(folder)
    gait = run.choose(best=True)
    page.choose(gait.cell)
    if start == "evaluation":
        page.page.select_option("#start", start)
    else:
        page.page.fill("#world-seed", "7")
        page.page.fill("#world-ranges", randomization)
        page.page.fill("#world-damage", damage)
        page.page.click("#world-go")
    page.wait(f"Explorer.view().starts[0] === '{start}'")
    task = make_task(run.settings.task, randomization, damage)
    if start == "evaluation":
        from pga_me_ros.core.evaluation import evaluation_rng

        rng = evaluation_rng(run.settings.seed, gait.evaluation)
    else:
        rng = np.random.default_rng(7)
    whole = record(task, gait.controller, rng)
    task.close()
    step = 10
    page.eval(f"Explorer.seek({step * run.spec.control_period})")
    assert page.eval("Explorer.view().joints[0]") == pytest.approx(
        whole.states[step].positions, abs=2e-3
    )


@pytest.mark.parametrize(
    ("field", "text", "why"),
    [
        ("ranges", "wind 1 2", "KIND is one of"),
        ("damage", "jam knee_joint", "its joints are thigh_joint, leg_joint, foot_joint"),
    ],
)
def test_what_cannot_be_simulated_says_why(page: Any, field: str, text: str, why: str) -> None:
    for name in ("ranges", "damage"):
        page.page.fill(f"#world-{name}", text if name == field else "")
    page.page.click("#world-go")
    page.wait(f"document.getElementById('no-stage').innerText.includes('{why}')")
    page.problems.clear()  # the browser notes the status 400
    page.page.select_option("#start", "evaluation")
    page.wait("document.getElementById('no-stage').hidden")


def test_a_gait_can_be_downloaded(page: Any, folder: Path, server: Server) -> None:
    run = StoredRun.load(folder)
    cell = run.choose(best=True).cell
    with page.page.expect_download() as download:
        page.page.click("#download-npz")
    assert download.value.suggested_filename == f"qd_hopper-cell{cell}.npz"
    which = f"?evaluation={run.behavior(cell).evaluation}"
    _, content = server.get(f"api/download/0/{cell}/npz{which}")
    arrays = np.load(io.BytesIO(content))
    assert np.array_equal(arrays["parameters"][0], run.behavior(cell).parameters)
    for kind in ("onnx", "torchscript"):
        status, content = server.get(f"api/download/0/{cell}/{kind}{which}")
        assert (status, len(content) > 4 * run.behavior(cell).parameters.size) == (200, True)
    assert server.get(f"api/download/0/{cell}/exe{which}")[0] == 400
    assert server.get(f"api/download/0/{cell}/npz")[0] == 400


def test_a_gait_that_was_replaced_since_is_not_taken_for_the_one_that_is_shown(
    page: Any, folder: Path, server: Server
) -> None:
    gait = StoredRun.load(folder).choose(best=True)
    other = 10**6  # no evaluation of this run
    for path in (f"motion/0/{gait.cell}?evaluation", f"download/0/{gait.cell}/npz?evaluation"):
        status, words = server.get(f"api/{path}={other}")
        assert (status, b"was replaced since; the map is being" in words) == (400, True)
        assert server.get(f"api/{path}={gait.evaluation}")[0] == 200
    # On the page, a gait beside the chosen one: it comes with the next update.
    page.choose(gait.cell)
    page.plays(gait.cell)
    page.page.click("#pin")
    page.eval(f"Store.chosen().evaluation = {other}")
    page.page.click("#download-npz")
    page.wait("document.getElementById('copied').innerText.includes('was replaced since')")
    page.choose(next(c for c in StoredRun.load(folder).archive.filled_cells() if c != gait.cell))
    page.wait("document.getElementById('no-stage').innerText.includes('was replaced since')")
    page.problems.clear()  # the browser notes the status 400
    page.eval("() => fetch('api/run/0').then((a) => a.json()).then((c) => Explorer.update(0, c))")
    page.wait("Explorer.view().cells.length === 2")
    page.page.click("#lanes button:has-text('✕')")
    page.wait("Explorer.view().cells.length === 1")


def test_only_the_page_itself_may_ask(server: Server) -> None:
    assert server.address.startswith("http://127.0.0.1:")
    assert server.said == (
        "The page is for this machine only and can control the run; Ctrl-C ends it."
    )
    assert server.get("api/run/0")[0] == 200
    assert server.get("api/run/5")[0] == 400
    assert server.get("", Host="evil.example")[0] == 403
    assert server.get("api/control/0", b"{}")[0] == 403
    status, words = server.get("api/control/0", b'{"action": "stop"}', X_Explorer="1")
    assert (status, b"shows a stored run" in words) == (400, True)


def test_a_page_for_others_needs_its_token_and_only_looks() -> None:
    others, own = (access_for(h, control=False, token=False) for h in ("0.0.0.0", "127.0.0.1"))
    assert (len(others.token) > 20, others.control) == (True, False)
    assert (own.token, own.control) == ("", True)
    assert access_for("0.0.0.0", control=True, token=False).control


def test_others_need_the_token_and_only_look(folder: Path, pages: Callable[..., Any]) -> None:
    server = started(str(folder), "--host", "0.0.0.0")
    page = pages(server.address)
    assert page.figures()["cell"]
    bare, token = server.address.split("?token=")
    assert server.said == (
        "The page is for everybody who can reach it, with this token and is read-only; Ctrl-C ends it."
    )
    closed = Server(server.process, bare, "")
    assert [closed.get(path)[0] for path in ("", "api/run/0", "?token=x")] == [403] * 3
    assert closed.get(f"api/run/0?token={token}")[0] == 200
    port = bare.rsplit(":", 1)[1].strip("/")
    cookies = [f"explorer_token_{port}={token}; explorer_token_1=x", f"explorer_token_1={token}"]
    assert [closed.get("api/run/0", Cookie=cookie)[0] for cookie in cookies] == [200, 403]
    path = f"api/control/0?token={token}"
    status, words = closed.get(path, b'{"action": "stop"}', X_Explorer="1")
    assert (status, b"This page is read-only" in words) == (400, True)
    server.process.send_signal(signal.SIGINT)
    assert server.process.wait(20) == 0
    page.wait("document.getElementById('message').innerText.includes('does not answer')")
    assert server.process.communicate()[1] == ""
    page.page.select_option("#start", "unseen:1")
    page.wait("document.getElementById('no-stage').innerText.includes('does not answer')")
    assert page.page.inner_text("#readings") == ""


def test_a_port_that_is_taken_is_told(
    server: Server, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    port = server.address.rsplit(":", 1)[1].strip("/")
    assert main([str(folder), "--port", port]) == 2
    assert f"Port {port} of 127.0.0.1 is taken" in capsys.readouterr().err


def test_a_browser_that_goes_away_costs_nothing(folder: Path) -> None:
    source = StoredSource(folder, "run")
    app = ExplorerServer([source], access_for("127.0.0.1", control=False, token=False), "", bool)
    with running(app.app) as port:
        for _ in range(3):
            with socket.create_connection(("127.0.0.1", port)) as browser:
                browser.sendall(b"GET /api/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
                assert browser.recv(1000)
        end = time.monotonic() + 30.0
        while app.watched:
            assert time.monotonic() < end
            threading.Event().wait(0.02)


def test_the_page_follows_its_files(
    page: Any, folder: Path, longer_run: Path, other_run: Path
) -> None:
    elites = len(StoredRun.load(longer_run).archive)
    before = page.eval("Explorer.state.runs[0].elites.length")
    assert elites > before
    file = folder / "repertoire.db"
    replace(longer_run / "repertoire.db", file)
    page.wait(f"Explorer.state.runs[0].elites.length === {elites}")
    assert f"{elites} gaits" in page.page.inner_text("#summary")
    assert page.problems == []

    file.write_bytes(b"no database" * 100)
    page.wait("!document.getElementById('message').hidden")
    assert "repertoire.db" in page.page.inner_text("#message")
    assert "the last state that could be read" in page.page.inner_text("#message")
    assert page.eval("document.querySelectorAll('.cell.elite').length") == elites
    replace(longer_run / "repertoire.db", file)
    page.wait("document.getElementById('message').hidden")

    replace(other_run / "repertoire.db", file)
    page.wait("document.getElementById('message').innerText.includes('Another run has taken')")

    shutil.rmtree(folder)
    page.wait("document.getElementById('message').innerText.includes('no repertoire')")
    assert page.eval("document.querySelectorAll('.cell.elite').length") == elites
    page.page.click("#download-npz")
    page.wait("document.getElementById('copied').innerText.includes('no repertoire')")
