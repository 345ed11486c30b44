"""Supplied configurations give the nodes the settings of Table 1, in any namespace."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
import yaml
from domain_coordinator import domain_id
from rclpy.context import Context
from rclpy.node import Node

from pga_me_ros.core.settings import Settings
from pga_me_ros.nodes.evaluator import EvaluatorSettings
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameters import declare, declare_run
from pga_me_ros.tasks.registry import BUILT_IN, task_spec

CONFIG = Path(__file__).resolve().parents[1] / "config"


def path_of(task: str) -> Path:
    return CONFIG / f"{task}.yaml"


@pytest.fixture
def context(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Context]:
    """Return a context whose command line has a configuration and a namespace."""
    task, namespace = request.param
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    arguments = ["--params-file", str(path_of(task)), "-r", f"__ns:={namespace}"]
    context = Context()
    with domain_id() as domain:
        rclpy.init(args=["node", "--ros-args", *arguments], context=context, domain_id=domain)
        yield context
        context.shutdown()


def in_namespaces(*namespaces: str) -> pytest.MarkDecorator:
    cases = [(task, namespace) for task in BUILT_IN for namespace in namespaces]
    return pytest.mark.parametrize("context", cases, indirect=True, ids=lambda c: c[0] + c[1])


def test_every_built_in_task_has_one() -> None:
    assert sorted(path.stem for path in CONFIG.glob("qd_*.yaml")) == sorted(BUILT_IN)


@pytest.mark.parametrize("path", sorted(CONFIG.glob("mujoco_*.yaml")), ids=lambda path: path.stem)
def test_mujoco_files_name_environments_that_exist(path: Path) -> None:
    content = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]
    settings = Settings(**content)
    assert settings.given == {"task": content["task"]}
    robot = path.stem.removeprefix("mujoco_").replace("_", "")
    assert robot in task_spec(settings.task).name.lower()


@in_namespaces("/", "/lab/two")
def test_the_orchestrator_gets_the_papers_settings_from_it(context: Context) -> None:
    node = Node(
        "orchestrator", context=context, automatically_declare_parameters_from_overrides=True
    )
    settings, options = declare_run(node, RunOptions)
    node.destroy_node()
    assert settings == Settings(task=task_spec(settings.task).name)
    assert RunOptions(**options) == RunOptions()


@in_namespaces("/")
def test_an_evaluator_gets_its_task_from_it(context: Context) -> None:
    node = Node(
        "evaluator_x_1", context=context, automatically_declare_parameters_from_overrides=True
    )
    values = declare(node, EvaluatorSettings, shared=(Settings, RunOptions))
    node.destroy_node()
    assert values["task"] in BUILT_IN


@pytest.mark.parametrize("task", BUILT_IN)
def test_it_has_only_values_that_differ_from_the_defaults(task: str) -> None:
    content = yaml.safe_load(path_of(task).read_text())["/**"]["ros__parameters"]
    assert content["task"] == task
    assert Settings(**content).given.items() <= content.items()


@pytest.mark.parametrize("task", BUILT_IN)
def test_the_values_that_it_suggests_are_the_defaults(task: str) -> None:
    suggested = "\n".join(re.findall(r"^    # (\w+: .*)$", path_of(task).read_text(), re.MULTILINE))
    values = yaml.safe_load(suggested)
    assert values
    assert Settings(task=task, **values) == Settings(task=task)


def preset(name: str) -> dict[str, object]:
    content: dict[str, object] = yaml.safe_load((CONFIG / "presets" / f"{name}.yaml").read_text())
    parameters = content["/**"]["ros__parameters"]  # type: ignore[index]
    assert isinstance(parameters, dict)
    return parameters


LATER = "pga_map_elites_later"
FIRST_WALK, FROM_WALK = "td3_first_walk", "dcrl_map_elites_from_walk"
PRESETS = (LATER, FIRST_WALK, FROM_WALK)


def test_every_preset_is_tested() -> None:
    assert {path.stem for path in (CONFIG / "presets").iterdir()} == set(PRESETS)


def test_the_later_rates_are_those_of_the_authors_lab() -> None:
    later = Settings(**preset(LATER))
    assert (later.algorithm, later.batch_size, later.random_init) == ("pga_map_elites", 256, 256)
    assert (later.n_evo, later.n_crit, later.transition_batch) == (128, 3000, 100)
    assert (later.n_grad, later.pg_learning_rate) == (150, 5e-3)
    successor = Settings(algorithm="dcrl_map_elites")
    shared = ("n_crit", "transition_batch", "n_grad", "pg_learning_rate", "batch_size")
    assert all(getattr(later, name) == getattr(successor, name) for name in shared)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_holds_what_differs_and_goes_with_any_task(name: str) -> None:
    values = preset(name)
    settings = Settings(**values)
    assert settings.given.keys() == values.keys()
    plain = Settings(algorithm=settings.algorithm)
    assert all(
        getattr(settings, name) != getattr(plain, name) for name in values.keys() - {"algorithm"}
    )
    assert "task" not in values


def test_a_repertoire_can_start_from_the_first_walk() -> None:
    walk, repertoire = (Settings(**preset(name)) for name in (FIRST_WALK, FROM_WALK))
    assert walk.exploration_correlation > 0
    assert walk.controller_hidden == repertoire.controller_hidden


def test_the_experiment_with_the_later_rates_has_those_of_the_preset() -> None:
    plan = yaml.safe_load((CONFIG / "experiments" / "successor.yaml").read_text())
    assert plan["systems"][LATER] == {"algorithm": "pga_map_elites", **preset(LATER)}
