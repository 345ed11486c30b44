"""Parts of a robot that are read once for several stay together in every motion, bit for bit."""

from __future__ import annotations

import numpy as np
import pybullet
import pytest

from pga_me_ros.tasks.bullet.coincidence import places_of
from pga_me_ros.tasks.registry import load_task


@pytest.fixture
def task(request):
    task = load_task(request.param)()
    yield task
    task.close()


def parts_of(task):
    return [*task._world.links.values()]


def positions(task):
    """Return x and y of every link, according to the engine."""
    world = task._world
    links = pybullet.getLinkStates(world.robot, parts_of(task), 0, 0, world.client)
    return {part: link[0][:2] for part, link in zip(parts_of(task), links, strict=True)}


@pytest.mark.parametrize("task", ["qd_walker", "qd_half_cheetah", "qd_hopper"], indirect=True)
def test_parts_in_one_place_stay_together(task):
    parts = parts_of(task)
    places = dict(zip(parts, places_of(task._world, parts), strict=True))
    rng = np.random.default_rng(0)
    for episode in range(3):
        task.reset(np.random.default_rng(episode))
        for _ in range(200):
            task.step(rng.uniform(-1, 1, task.spec.action_dim).astype(np.float32))
            read = positions(task)
            assert read == {part: read[place] for part, place in places.items()}


@pytest.mark.parametrize(
    ("task", "places"),
    [("qd_walker", 14), ("qd_half_cheetah", 7), ("qd_hopper", 8)],
    indirect=["task"],
)
def test_planar_robots_have_fewer_places_than_parts(task, places):
    found = places_of(task._world, parts_of(task))
    assert len(set(found)) == places < len(found)
    assert task._world.torso in found


@pytest.mark.parametrize("task", ["qd_ant"], indirect=True)
def test_no_two_parts_of_an_ant_are_in_one_place(task):
    parts = [-1, *parts_of(task)]
    assert places_of(task._world, parts) == parts


@pytest.mark.parametrize("task", ["qd_half_cheetah"], indirect=True)
def test_looking_for_places_does_not_disturb_the_next_episode(task):
    first = task.reset(np.random.default_rng(0)).tobytes()
    places_of(task._world, parts_of(task))
    assert task.reset(np.random.default_rng(0)).tobytes() == first
