"""What an open page of the explorer costs a run: its generations without one, with one, and with a slow client.

Run: `.venv/bin/python bench/explorer.py [--rounds 1] [--play]`; the last line is JSON. A run of QDWalker with two
evaluators is watched in turns while it goes on: for some generations by nobody (A), for others by a page that is open
in a headless Chromium (B), or by a client that asks for news and reads nothing (C). A round is three runs, so that each
turn is watched in each of these ways once: in the order A B C, B C A, C A B. Every run has the same generations, and
all must end with the same repertoire, bit for bit; what differs is who watched when. The figures compare the three
runs turn by turn, as generations differ more than a page costs, and give the median over the turns:

- `time`: the time of B and C relative to A (medians of the turn's generations), as far as this machine is quiet.
- `core time`: the core time of the run and of those who watch, relative to that in A. It tells what the run pays for
  answers, too; time that other work takes away from this machine is no part of it.
- `share`: the core time of the explorer and the browser as a share of what this machine's cores have to give.

Opening the page is not part of them. Chromium takes part in the time of this machine's cores: it draws the map again
whenever generations have come in. Without a graphics card, robots in motion would be drawn by the processor, too; so
they stand still, unless `--play` is given.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from _measure import spread
from _processes import core_seconds, core_seconds_beside, running, wait_for_generation
from _run_times import committed

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test/explorer"))

from browsing import Page, running_browser

from pga_me_ros.core.storage.repertoire import Repertoire

SKIPPED = 6
"""Generations before the first turn: random controllers, and the start of the processes."""

OPENING = 6
"""Generations of each turn that are not compared: the explorer starts, and the browser loads the page."""

AFTER = 3
"""Generations after the last turn, so that the processes are still there to tell their core time."""

WAYS = ("none", "page", "slow")


@contextmanager
def explorer() -> Iterator[str]:
    """Start the explorer of the running graph, and give the address of its page."""
    command = [sys.executable, "-m", "pga_me_ros.explorer", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()


@contextmanager
def open_page(browser: Any, play: bool) -> Iterator[None]:
    """Open the page in the browser."""
    with explorer() as address:
        page = Page(browser, address, reduced_motion="no-preference" if play else "reduce")
        try:
            yield
            if page.problems:
                raise SystemExit(f"the page complains: {page.problems}")
        finally:
            page.close()


@contextmanager
def slow_client() -> Iterator[None]:
    """Ask for the page's news, and read none of it."""
    with explorer() as address:
        found = re.fullmatch(r"http://(.+):(\d+)/", address)
        assert found
        with socket.create_connection((found[1], int(found[2]))) as connection:
            connection.sendall(f"GET /api/events HTTP/1.1\r\nHost: {found[1]}\r\n\r\n".encode())
            yield


class Turn(NamedTuple):
    """What some generations took.

    Attributes:
        way: Who watched.
        seconds: Median of their seconds.
        cores: Core seconds of the run and of who watched.
        share: Core time of who watched, as a share of what this machine's cores had to give.
    """

    way: str
    seconds: float
    cores: float
    share: float


def run(order: Sequence[str], generations: int, browser: Any, play: bool) -> tuple[list[Turn], str]:
    """Carry out a run.

    Args:
        order: Who watches, one after the other.
        generations: Generations of each turn that are compared.
        browser: The browser.
        play: Whether the robot moves on the page.

    Returns:
        The turns, and the repertoire's digest.
    """
    length = OPENING + generations
    values = {
        "task": "qd_walker",
        "seed": 1,
        "random_init": 500,
        "evaluations": 100 * (SKIPPED + len(order) * length + AFTER),
        "evaluators": 2,
        "serve": "false",
        "reevaluations": 0,
    }
    watching: dict[str, Callable[[], AbstractContextManager[None]]] = {
        "none": nullcontext,
        "page": lambda: open_page(browser, play),
        "slow": slow_client,
    }
    turns: list[Turn] = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "repertoire.db"
        with running(folder, values) as process:
            for number, way in enumerate(order):
                start = SKIPPED + number * length
                wait_for_generation(process, file, start - 1)
                with watching[way]():
                    if len(committed(file)) > start + OPENING:
                        raise SystemExit("Opening the page took too long; is this machine busy?")
                    wait_for_generation(process, file, start + OPENING - 1)
                    before = _core_times(process.pid)
                    wait_for_generation(process, file, start + length - 1)
                    after = _core_times(process.pid)
                elapsed, cores, watched = (b - a for a, b in zip(before, after, strict=True))
                times = committed(file)[start + OPENING - 1 : start + length]
                seconds = statistics.median(b - a for a, b in pairwise(times))
                share = watched / elapsed / (os.cpu_count() or 1)
                turns.append(Turn(way, seconds, cores + watched, share))
                print(
                    f"generation {start + OPENING}, {way}: median {seconds:.3f} s of {generations}, "
                    f"core time {cores:.1f} s, and {watched:.1f} s ({share:.1%}) for who watches",
                    flush=True,
                )
            process.wait()
        with Repertoire.open(file, read_only=True) as repertoire:
            return turns, repertoire.result_digest()


def _core_times(orchestrator: int) -> tuple[float, float, float]:
    """Return the time, and the core seconds so far of the run and of those who watch."""
    run_only = sum(core_seconds(orchestrator).values())
    return time.perf_counter(), run_only, core_seconds_beside(orchestrator)


def measure(rounds: int, turns: int, generations: int, browser: Any, play: bool) -> dict[str, Any]:
    """Carry out the runs, and return the figures."""
    figures: dict[str, dict[str, list[float]]] = {
        way: {"time": [], "core time": [], "share": []} for way in WAYS[1:]
    }
    digests = set()
    for _ in range(rounds):
        found = []
        for shift in range(len(WAYS)):
            order = [WAYS[(turn + shift) % len(WAYS)] for turn in range(turns)]
            run_turns, digest = run(order, generations, browser, play)
            found.append(run_turns)
            digests.add(digest)
        for same in zip(*found, strict=True):
            by_way = {turn.way: turn for turn in same}
            without = by_way.pop("none")
            for way, turn in by_way.items():
                figures[way]["time"].append(turn.seconds / without.seconds)
                figures[way]["core time"].append(turn.cores / without.cores)
                figures[way]["share"].append(turn.share)
    if len(digests) > 1:
        raise SystemExit(f"the repertoires differ: {digests}")
    return {way: {name: spread(v) for name, v in rows.items()} for way, rows in figures.items()}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=1, help="rounds of three runs")
    parser.add_argument("--turns", type=int, default=6, help="turns in each run")
    parser.add_argument("--generations", type=int, default=25, help="generations of each turn")
    parser.add_argument("--play", action="store_true", help="let the robot move on the page")
    arguments = parser.parse_args()
    with running_browser() as browser:
        figures = measure(
            arguments.rounds, arguments.turns, arguments.generations, browser, arguments.play
        )
    print(json.dumps({"bench": "explorer", "relative_to_none": figures}))


if __name__ == "__main__":
    main()
