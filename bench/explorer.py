"""What an open page of the explorer costs a run: the same generations without one, with one, and with a slow client.

Run: `.venv/bin/python bench/explorer.py [--rounds 3] [--play]`; the last line is JSON. Each round does the same
generations of QDWalker three times, with two evaluators: without an explorer (A), with a page open in a headless
Chromium (B), and with a client that asks for news and reads nothing (C), in the order A B C A B C ... The figures are
the times of B and C relative to A, each as the ratio of the medians over all generations of all rounds. The repertoires
must be equal, bit for bit.

Times of single runs differ by more than a page costs, so the core time of the explorer and the browser is counted, too,
as a share of what this machine's cores have to give while the generations go on. Loading the page is part of it if it
goes on after the first of these generations, so give some hundred --generations to see what an open page takes.

Chromium takes part in the time of this machine's cores: it draws the map again whenever generations have come in.
Without a graphics card, robots in motion would be drawn by the processor, too; so they stand still, unless `--play` is
given.
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
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from itertools import pairwise
from pathlib import Path
from typing import Any

from _measure import spread
from _processes import core_seconds_beside, running, wait_for_generation
from _run_times import committed

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test/explorer"))

from browsing import Page, running_browser

from pga_me_ros.core.storage.repertoire import Repertoire

SKIPPED = 6
"""Generations before those that are compared: random controllers, and the start of the processes."""

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


def run(way: str, generations: int, browser: Any, play: bool) -> tuple[list[float], str, float]:
    """Carry out a run.

    Returns:
        The seconds of each compared generation, the repertoire's digest, and the core time of who watched, as a share
        of that of the machine.
    """
    values = {
        "task": "qd_walker",
        "seed": 1,
        "random_init": 500,
        "evaluations": 100 * (SKIPPED + generations),
        "evaluators": 2,
        "serve": "false",
        "reevaluations": 0,
    }
    watching = {
        "none": nullcontext,
        "page": lambda: open_page(browser, play),
        "slow": slow_client,
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "repertoire.db"
        with running(folder, values) as process:
            wait_for_generation(process, file, 0)
            with watching[way]():
                first = max(SKIPPED, len(committed(file)) + 1)  # the page may have opened late
                wait_for_generation(process, file, first)
                began, used = time.perf_counter(), core_seconds_beside(process.pid)
                wait_for_generation(process, file, SKIPPED + generations - 1)
                used = core_seconds_beside(process.pid) - used
                share = used / (time.perf_counter() - began) / (os.cpu_count() or 1)
            process.wait()
        with Repertoire.open(file, read_only=True) as repertoire:
            digest = repertoire.result_digest()
        seconds = [b - a for a, b in pairwise(committed(file))]
    if first > len(seconds):
        raise SystemExit(
            f"The run ended before the page was open; give more --generations than {generations}."
        )
    return seconds[first - 1 :], digest, share


def measure(rounds: int, generations: int, browser: Any, play: bool) -> dict[str, Any]:
    """Take turns, and return the figures."""
    seconds: dict[str, list[list[float]]] = {way: [] for way in WAYS}
    shares: dict[str, list[float]] = {way: [] for way in WAYS}
    digests = set()
    for number in range(rounds):
        for way in WAYS:
            began = time.perf_counter()
            found, digest, share = run(way, generations, browser, play)
            seconds[way].append(found)
            shares[way].append(share)
            digests.add(digest)
            print(
                f"round {number + 1}, {way}: median {statistics.median(found):.3f} s of {len(found)} generations, "
                f"{time.perf_counter() - began:.0f} s in all, "
                f"{100 * share:.1f} % of the cores' time for who watches",
                flush=True,
            )
    if len(digests) > 1:
        raise SystemExit(f"the repertoires differ: {digests}")
    return {
        way: {
            "all": round(_median(seconds[way]) / _median(seconds["none"]), 3),
            "rounds": spread(
                [
                    _median([b]) / _median([a])
                    for a, b in zip(seconds["none"], seconds[way], strict=True)
                ]
            ),
            "share of core time": spread(shares[way]),
        }
        for way in WAYS[1:]
    }


def _median(rows: list[list[float]]) -> float:
    """Return the median over the generations that all rows have, counted from the last one."""
    least = min(len(row) for row in rows)
    return statistics.median(value for row in rows for value in row[-least:])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--generations", type=int, default=20, help="generations to compare")
    parser.add_argument("--play", action="store_true", help="let the robot move on the page")
    arguments = parser.parse_args()
    with running_browser() as browser:
        figures = measure(arguments.rounds, arguments.generations, browser, arguments.play)
    print(json.dumps({"bench": "explorer", "time_without": figures}))


if __name__ == "__main__":
    main()
