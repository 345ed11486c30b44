"""Watching or drawing an episode does not change it."""

from __future__ import annotations

import numpy as np
import pytest
from posed import TASKS

from pga_me_ros.core.evaluation import evaluation_rng
from pga_me_ros.core.networks.controller import MlpController
from pga_me_ros.core.networks.mlp import random_parameters
from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import TaskError
from pga_me_ros.player.body_reader import BodyReader
from pga_me_ros.player.camera import Camera
from pga_me_ros.player.watched_rollout import record, watched_rollout
from pga_me_ros.render.scene import Scene
from pga_me_ros.tasks.registry import make_task, task_spec
from pga_me_ros.tasks.rollout import rollout


def controller(task: str) -> MlpController:
    shape = controller_shape(task_spec(task), Settings(controller_hidden=(16, 16)))
    return MlpController(shape, random_parameters(shape, np.random.default_rng(5)))


@pytest.mark.parametrize("name", TASKS)
def test_watching_and_drawing_change_no_bit(name: str) -> None:
    task = make_task(name)
    alone = rollout(task, controller(name), evaluation_rng(3, 1))
    scenes: list[Scene] = []

    def look(step: int, reader: BodyReader) -> None:
        state = reader.state()
        if step == 0:
            scenes.append(Scene(reader.model, 40, 30))
        if step % 20 == 0 and step < 200:
            scenes[0].picture(state, Camera.for_robot(reader.model, state))

    watched = watched_rollout(task, controller(name), evaluation_rng(3, 1), look)
    scenes[0].close()
    task.close()
    assert watched.fitness == alone.fitness
    assert np.array_equal(watched.descriptor, alone.descriptor)
    assert np.array_equal(watched.states, alone.states)


def test_a_recording_has_the_first_and_every_nth_state() -> None:
    task = make_task("qd_walker")
    done = record(task, controller("qd_walker"), evaluation_rng(3, 1), every=4)
    task.close()
    assert done.steps == tuple(range(0, done.episode.length + 1, 4))
    assert len(done.states) == len(done.steps)


def test_a_task_without_a_body_is_named() -> None:
    class Bodiless:
        spec = task_spec("qd_walker")

    with pytest.raises(TaskError, match="'qd_walker' cannot be shown: it has no property 'body'"):
        record(Bodiless(), controller("qd_walker"), evaluation_rng(3, 1))  # type: ignore[arg-type]
