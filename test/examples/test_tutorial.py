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

GROW, REPORT, SERVE, RUN = range(4)


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
    named = re.findall(r"`([^` ]+\.png)`", (ROOT / "docs" / "tutorial.md").read_text())
    made = {path.name for path in (tutorial.shell.folder / "runs").rglob("*.png")}
    assert len(named) == 3
    assert {Path(name).name for name in named} <= made


def test_the_robot_runs_the_gait_that_it_asked_for(tutorial: Tutorial) -> None:
    (code,) = blocks("tutorial.md", "python")
    (tutorial.shell.folder / "robot.py").write_text(code)
    output = tutorial.shell.run(tutorial.commands[RUN])
    assert re.findall(r"^(\w+): fitness -?[0-9.]+, foot", output, re.MULTILINE) == [
        "promised",
        "achieved",
    ]


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
