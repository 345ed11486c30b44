"""A program in another language needs the response of get_behavior or get_actor and nothing else."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pga_me_msgs.srv import GetActor, GetBehavior

from pga_me_ros import StoredRun, make_task
from pga_me_ros.arrays import Float32Array
from pga_me_ros.client.controller import Controller
from pga_me_ros.ros.convert import behavior_to_msg, controller_to_msg
from pga_me_ros.serving.actor_service import actor_to_msg
from pga_me_ros.tasks.registry import BUILT_IN
from pga_me_ros.tasks.rollout import rollout

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def as_json(message: object) -> str:
    """Return a message as JSON, by the example's own function."""
    spec = importlib.util.spec_from_file_location("save_response", EXAMPLES / "save_response.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    # NaN, as for a mean without re-evaluations, is no JSON; rosbridge sends null.
    return json.dumps(module.as_json(message)).replace("NaN", "null")


@pytest.fixture(scope="module")
def episode(hopper_run: Path, tmp_path_factory: pytest.TempPathFactory):
    """Return the file of a response, measurements of an episode, and the actions of the Python controller."""
    run = StoredRun.load(hopper_run)
    elite = run.archive.best()
    response = GetBehavior.Response(found=True, behavior=behavior_to_msg(elite))
    response.controller = controller_to_msg(elite.parameters, run.shape, run.spec)
    controller = Controller.from_msg(response.controller)
    file = tmp_path_factory.mktemp("response") / "response.json"
    file.write_text(as_json(response), encoding="utf-8")
    task = make_task("qd_hopper")
    seen = rollout(task, controller, np.random.default_rng(3)).states[:-1]
    limits = np.array(task._world.joint_limits)
    task.close()
    assert len(seen) > 10
    measured = seen.astype(np.float64)
    for (low, high), name in zip(
        limits, task.spec.joint_names, strict=True
    ):  # as a robot's encoders say it
        entry = task.spec.observation_names.index(f"{name}/position")
        measured[:, entry] = low + (measured[:, entry] + 1) / 2 * (high - low)
    measured = np.vstack([measured, measured[0] + 1000.0])  # far beyond every limit
    limited = [*seen, np.full(len(seen[0]), 5.0, np.float32)]
    return file, measured, np.array([controller(row) for row in limited])


def actions(command: list[str], measured: Float32Array) -> np.ndarray:
    """Return what a program answers to observations."""
    lines = "\n".join(" ".join(f"{x:.17g}" for x in row) for row in measured)
    done = subprocess.run(
        command, input=lines, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    return np.array([[float(x) for x in line.split()] for line in done.stdout.splitlines()])


@pytest.fixture(scope="module")
def asked(dcrl_run: Path, tmp_path_factory: pytest.TempPathFactory):
    """Return the file of an actor's response, observations with wanted descriptors, and the actions of the actor."""
    run = StoredRun.load(dcrl_run)
    actor = run.actor()
    response = GetActor.Response(found=True, controller=actor_to_msg(actor, run.spec))
    file = tmp_path_factory.mktemp("response") / "actor.json"
    file.write_text(as_json(response), encoding="utf-8")
    rng = np.random.default_rng(4)
    seen = rng.uniform(-1, 1, (40, run.spec.observation_dim)).astype(np.float32)
    wanted = np.linspace(-0.5, 1.5, len(seen))[:, None]  # beyond the bounds, too
    measured = seen.astype(np.float64)
    spec = run.spec
    for low, high, name in zip(spec.joint_low, spec.joint_high, spec.joint_names, strict=True):
        entry = spec.observation_names.index(f"{name}/position")
        measured[:, entry] = low + (measured[:, entry] + 1) / 2 * (high - low)
    expected = [actor(o, d) for o, d in zip(seen, wanted, strict=True)]
    return file, np.hstack([measured, wanted]), np.array(expected)


@pytest.fixture(params=["episode", "asked"], ids=["controller", "actor"])
def case(request: pytest.FixtureRequest):
    """Return a response's file, what a robot measures, and the actions that are expected."""
    return request.getfixturevalue(request.param)


def test_a_javascript_program_acts_as_the_controller(case) -> None:
    node = shutil.which("node")
    if not node:
        pytest.skip("node is not installed")
    file, measured, expected = case
    answers = actions([node, str(EXAMPLES / "run_controller.js"), str(file)], measured)
    np.testing.assert_allclose(answers, expected, rtol=0, atol=1e-6)


def test_a_cpp_program_acts_as_the_controller(case, tmp_path: Path) -> None:
    compiler = shutil.which("g++")
    if not compiler:
        pytest.skip("g++ is not installed")
    file, measured, expected = case
    program = tmp_path / "run_controller"
    source = str(EXAMPLES / "run_controller.cpp")
    flags = ["-std=c++17", "-O1", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([compiler, *flags, source, "-o", str(program)], check=True, timeout=120)
    answers = actions([str(program), str(file)], measured)
    np.testing.assert_allclose(answers, expected, rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", BUILT_IN)
def test_the_limits_of_the_spec_are_those_of_the_simulated_robot(name: str) -> None:
    task = make_task(name)
    spec = task.spec
    try:
        assert list(zip(spec.joint_low, spec.joint_high, strict=True)) == task._world.joint_limits
    finally:
        task.close()
    assert set(spec.observation_high) == {5.0}
    assert [
        n.removesuffix("/position") for n in spec.observation_names if "/position" in n
    ] == list(spec.joint_names)


def test_a_controller_of_an_older_repertoire_has_no_limits(hopper_run: Path) -> None:
    import dataclasses

    run = StoredRun.load(hopper_run)
    none = dict.fromkeys(
        ("observation_low", "observation_high", "joint_names", "joint_low", "joint_high"), ()
    )
    message = controller_to_msg(
        run.archive.best().parameters, run.shape, dataclasses.replace(run.spec, **none)
    )
    controller = Controller.from_msg(message)
    assert controller.joint_names == ()
    assert controller.observation_low.size == 0
    assert controller.descriptor_names == ("foot/contact_share",)
