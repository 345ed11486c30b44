"""The explorer shows robots of MuJoCo as it does those of PyBullet."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.explorer.motion import EpisodeStart
from pga_me_ros.explorer.recorder import Recorder


def test_a_gait_of_a_mujoco_robot_is_recorded(new_run: Callable[..., Path]) -> None:
    name = "gymnasium:Hopper-v5?max_steps=40"
    run = StoredRun.load(new_run(task=name, evaluations=10, random_init=10))
    gait = run.choose(best=True)
    recorder = Recorder(run.settings, lambda _: gait)
    assert recorder.missing == ""
    assert recorder.model is not None
    assert [link["name"] for link in recorder.model["links"]] == [
        "base_link",
        "torso",
        "thigh",
        "leg",
        "foot",
    ]
    assert all(link["shapes"][0]["kind"] == "capsule" for link in recorder.model["links"][1:])
    motion = recorder.motion(gait.cell, EpisodeStart())
    recorder.close()
    assert motion["kept"]
    assert motion["frames"]["columns"] == 7 + 3  # pose of the base, three joints
    assert motion["fitness"] == gait.promised_fitness
