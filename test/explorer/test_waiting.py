"""Who waits for whom: nobody who steers waits for a simulation, and nothing is simulated for those who have gone."""

from __future__ import annotations

import socket
import threading
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from serving import running
from starlette.requests import Request

from pga_me_ros.explorer.live import access_for
from pga_me_ros.explorer.server import Server
from pga_me_ros.explorer.source import StoredSource
from pga_me_ros.player.gait import Gait

PATIENCE = 30.0


class Busy(StoredSource):
    """A repertoire whose gaits come only when they may; it can be steered."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, "busy")
        self.asked: list[int] = []
        self.begun, self.may_go_on = threading.Event(), threading.Event()

    def gait(self, cell: int) -> Gait:
        self.asked.append(cell)
        self.begun.set()
        self.may_go_on.wait()
        return super().gait(cell)

    def control(self, action: str, values: dict[str, Any]) -> str:
        return f"{action} it is"


@pytest.fixture
def source(hopper_run: Path) -> Iterator[Busy]:
    source = Busy(hopper_run)
    yield source
    source.may_go_on.set()


@pytest.fixture
def port(source: Busy) -> Iterator[int]:
    ending = threading.Event()
    access = access_for("127.0.0.1", control=True, token=False)
    with running(Server([source], access, "", ending.is_set).app) as port:
        yield port
        source.may_go_on.set()
        ending.set()


def motion(source: Busy, place: int) -> tuple[int, str]:
    """Return a cell, and the request for its motion."""
    gait = source.run.behavior(int(source.run.archive.filled_cells()[place]))
    return gait.cell, f"/api/motion/0/{gait.cell}?evaluation={gait.evaluation}"


def asked(port: int, path: str) -> socket.socket:
    """Return a connection on which something was asked for."""
    connection = socket.create_connection(("127.0.0.1", port), PATIENCE)
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode())
    return connection


def steered(port: int) -> bytes:
    """Pause the run; returns the answer."""
    request = urllib.request.Request(
        f"http://127.0.0.1:{port}/api/control/0", b'{"action": "pause"}', {"X-Explorer": "1"}
    )
    with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
        content: bytes = answer.read()
    return content


def test_who_steers_does_not_wait_for_a_simulation(source: Busy, port: int) -> None:
    with asked(port, motion(source, 0)[1]):
        assert source.begun.wait(PATIENCE)
        assert steered(port) == b'{"said":"pause it is"}'
        assert not source.may_go_on.is_set()


def test_nothing_is_simulated_for_those_who_have_gone(
    source: Busy, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    noticed = threading.Event()
    is_disconnected = Request.is_disconnected

    async def noting(request: Request) -> bool:
        gone = await is_disconnected(request)
        if gone:
            noticed.set()
        return gone

    monkeypatch.setattr(Request, "is_disconnected", noting)
    (first, path), (_, impatient), (last, patient) = (motion(source, k) for k in range(3))
    with asked(port, path) as connection:
        assert source.begun.wait(PATIENCE)
        asked(port, impatient).close()
        assert noticed.wait(PATIENCE)
        steered(port)  # by then, the server has also acted upon it
        source.may_go_on.set()
        assert connection.recv(100).startswith(b"HTTP/1.1 200")
    with asked(port, patient) as connection:
        assert connection.recv(100).startswith(b"HTTP/1.1 200")
    assert source.asked == [first, last]


def test_the_page_gives_up_a_gait_when_another_is_chosen(
    source: Busy, port: int, pages: Callable[..., Any]
) -> None:
    page = pages(f"http://127.0.0.1:{port}/")
    assert source.begun.wait(PATIENCE)
    best = page.eval("Explorer.state.cell")
    other = next(cell for cell in source.run.archive.filled_cells().tolist() if cell != best)
    with page.page.expect_event("requestfailed") as failed:
        page.choose(other)
    assert f"/api/motion/0/{best}?" in failed.value.url
    source.may_go_on.set()
    page.plays(other)
    assert source.asked == [best, other]
