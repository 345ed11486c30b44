"""Robots in motion on the page: as in the rollout, in step, at the speed that is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browsing import DAMAGE, RANDOMIZATION
from browsing import UNSEEN_SEED as SEED

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.explorer.recorder import chosen_cells
from pga_me_ros.player.watched_rollout import record
from pga_me_ros.tasks.registry import make_task


@pytest.mark.parametrize(
    "start",
    [
        "evaluation",
        f"unseen:{SEED}",
        f"randomized:{SEED}:{RANDOMIZATION}",
        f"damaged:{SEED}::{DAMAGE}",
    ],
    ids=["evaluation", "unseen", "randomized", "damaged"],
)
def test_the_joints_are_those_of_the_rollout(page: Any, run: StoredRun, start: str) -> None:
    cell = chosen_cells(run, 3)[0]
    page.choose(cell)
    page.page.select_option("#start", start)
    page.wait(f"Explorer.view().cells[0] === {cell} && Explorer.view().starts[0] === '{start}'")
    gait = run.behavior(cell)
    rng = (
        np.random.default_rng(SEED)
        if start != "evaluation"
        else evaluation_rng(run.settings.seed, gait.evaluation)
    )
    task = make_task(
        run.settings.task,
        RANDOMIZATION if start.startswith("randomized") else "",
        DAMAGE if start.startswith("damaged") else "",
    )
    whole = record(task, gait.controller, rng)
    task.close()
    for step in (0, 10, 40, 100)[: 2 if whole.episode.terminated else 4]:
        page.eval(f"Explorer.seek({step * run.spec.control_period})")
        assert page.eval("Explorer.view().joints[0]") == pytest.approx(
            whole.states[step].positions, abs=2e-3
        )
    page.page.select_option("#start", "evaluation")


def test_what_a_robot_has_lost_is_not_drawn(page: Any, run: StoredRun) -> None:
    page.choose(chosen_cells(run, 3)[0])
    pictures = []
    for start in (f"unseen:{SEED}", f"damaged:{SEED}::{DAMAGE}"):
        page.page.select_option("#start", start)
        page.wait(f"Explorer.view().starts[0] === '{start}'")
        page.eval("(Explorer.play(false), Explorer.seek(0))")
        assert page.picture() == page.picture()
        pictures.append(page.picture())
    joints = page.eval("Explorer.view().joints[0]")
    page.page.select_option("#start", f"unseen:{SEED}")
    page.wait(f"Explorer.view().starts[0] === 'unseen:{SEED}'")
    page.eval("(Explorer.play(false), Explorer.seek(0))")
    assert page.eval("Explorer.view().joints[0]")[:2] == pytest.approx(joints[:2], abs=1e-3)
    assert pictures[0] != pictures[1]
    page.page.select_option("#start", "evaluation")


def test_play_and_pause(page: Any, run: StoredRun) -> None:
    page.choose(chosen_cells(run, 3)[0])
    page.eval("Explorer.seek(0)")
    page.page.click("#play")
    page.wait("Explorer.view().time > 0.3")
    assert page.page.inner_text("#play") == "Pause"
    page.page.click("#play")
    assert page.eval("Explorer.view().playing") is False
    assert page.page.inner_text("#play") == "Play"


def test_speed_slider_and_strip(page: Any, run: StoredRun) -> None:
    cell = chosen_cells(run, 3)[0]
    page.choose(cell)
    page.plays(cell)
    page.page.select_option("#speed", "0.1")
    began = page.eval("(Explorer.seek(0), Explorer.play(true), performance.now())")
    page.wait("Explorer.view().time > 0.05")
    time, now = page.eval("(Explorer.play(false), [Explorer.view().time, performance.now()])")
    assert time <= 0.1 * (now - began) / 1000.0 + 1e-6
    page.page.select_option("#speed", "1")
    page.page.locator("#time").fill("2")
    assert page.eval("Explorer.view().time") == 2.0
    assert page.page.inner_text("#readings").startswith("2.00 of 16.50 s · ")
    page.page.click("#strip")  # in its middle
    end = page.eval("Explorer.view().end")
    assert page.eval("Explorer.view().time") == pytest.approx(end / 2, rel=0.01)


def test_gaits_side_by_side_move_in_step(page: Any, run: StoredRun) -> None:
    first, second, _ = chosen_cells(run, 3)
    page.choose(first)
    page.plays(first)
    page.page.click("#pin")
    page.choose(second)
    page.wait("Explorer.view().cells.length === 2")
    page.eval("Explorer.seek(1)")
    one, other = page.eval("Explorer.view().joints")
    assert one != other
    page.page.click("#lanes button:has-text('✕')")
    page.wait("Explorer.view().cells.length === 1")


def test_a_gait_that_was_not_recorded_says_so(page: Any, run: StoredRun) -> None:
    cell = next(c for c in run.archive.filled_cells().tolist() if c not in chosen_cells(run, 3))
    page.choose(cell)
    page.page.wait_for_selector("#no-stage:visible")
    assert f"The motion of cell {cell} is not in this file" in page.page.inner_text("#no-stage")
    assert page.figures()["cell"] == str(cell)
