"""The tutorial, from its first command to its last, with a smaller budget; and the shell example."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from commands import ROOT, TINY, Shell, blocks
from domain_coordinator import domain_id
from pga_me_msgs.srv import GetBehavior
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

GROW, REPORT, SERVE, RUN, RUN_A_STEADY_ONE, DRAW = range(6)


TEXT = (ROOT / "docs" / "tutorial.md").read_text()


@dataclass
class Tutorial:
    """The tutorial after the step in which the repertoire is served."""

    shell: Shell
    domain: int
    commands: list[str]


@pytest.fixture(scope="module")
def tutorial(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Tutorial]:
    commands = blocks("tutorial.md", "bash")
    folder = tmp_path_factory.mktemp("tutorial")
    with domain_id() as domain:
        shell = Shell(domain, folder)
        shell.run(f"{commands[GROW].strip()} {TINY}")
        with shell.started(f"exec {commands[SERVE]}"):
            yield Tutorial(shell, domain, commands)


def test_the_report_makes_the_named_pictures(tutorial: Tutorial) -> None:
    tutorial.shell.run(tutorial.commands[REPORT])
    named = re.findall(r"`([^` ]+\.png)`", TEXT)
    made = {path.name for path in (tutorial.shell.folder / "runs").rglob("*.png")}
    assert len(named) == 3
    assert {Path(name).name for name in named} <= made


@pytest.fixture(scope="module")
def robot(tutorial: Tutorial) -> Tutorial:
    """Save the robot's program where the tutorial says."""
    (code,) = blocks("tutorial.md", "python")
    (tutorial.shell.folder / "robot.py").write_text(code)
    return tutorial


def test_the_robot_runs_the_gait_that_it_asked_for(robot: Tutorial) -> None:
    output = robot.shell.run(robot.commands[RUN])
    assert re.findall(r"^(\w+): fitness -?[0-9.]+, foot", output, re.MULTILINE) == [
        "promised",
        "achieved",
    ]
    assert re.search(r"^(fell|still up) after \d+\.\d s$", output, re.MULTILINE)


def test_the_last_robot_keeps_its_promise_as_shown(robot: Tutorial) -> None:
    output = robot.shell.run(robot.commands[RUN_A_STEADY_ONE])
    (shown,) = re.findall(r"^```\n(promised.*?)```$", TEXT, re.DOTALL | re.MULTILINE)
    number = re.compile(r"[0-9.]+")
    assert number.sub("#", output) == number.sub("#", shown)
    assert output.splitlines()[0] == shown.splitlines()[0], "what is promised is stored"
    # Another machine may compute other bits, which grow to other digits in a thousand steps.
    got, expected = ([float(x) for x in number.findall(text)] for text in (output, shown))
    assert got == pytest.approx(expected, rel=0.05)
    assert output.endswith("still up after 16.5 s\n")


def test_the_last_robot_can_be_seen(robot: Tutorial) -> None:
    small = robot.commands[DRAW].strip() + " --seconds 0.2"
    assert "hop.gif" in robot.shell.run(small)


def test_the_request_of_the_shell_example_is_answered(tutorial: Tutorial) -> None:
    # The wheels lack the ros2 command, so its YAML is parsed and sent here.
    text = (ROOT / "examples" / "query_behavior.sh").read_text()
    ((name, kind, request),) = re.findall(r'^ros2 service call (\S+) (\S+) "(.*)"$', text, re.M)
    assert kind == "pga_me_msgs/srv/GetBehavior"
    values = yaml.safe_load(request)
    assert set(values) <= set(GetBehavior.Request.get_fields_and_field_types())
    values["descriptor"] = values["descriptor"][
        :1
    ]  # the hopper's repertoire has only one dimension
    answer = call(tutorial.domain, name, {**values, "max_distance": 1.0})
    assert answer.found, answer.message
    assert len(answer.controller.parameters) > 0


def call(domain: int, name: str, values: dict[str, Any]) -> GetBehavior.Response:
    """Call get_behavior with the fields of a request."""
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = rclpy.create_node("shell", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        client = node.create_client(GetBehavior, name)
        assert client.wait_for_service(60.0)
        future = client.call_async(GetBehavior.Request(**values))
        executor.spin_until_future_complete(future, 60.0)
        return future.result()
    finally:
        executor.shutdown()
        node.destroy_node()
        context.shutdown()


def test_the_setup_commands_exist() -> None:
    setup, source = blocks("tutorial.md")[0].splitlines()
    assert re.search(rf"^{setup.removeprefix('make ')}:", (ROOT / "Makefile").read_text(), re.M)
    assert source == "source .venv/setup.bash"
    assert (ROOT / "scripts" / "setup.bash").exists()
