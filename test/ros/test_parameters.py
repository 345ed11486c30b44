"""Parameters of a real node, given as on a command line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import pytest
import rclpy
from domain_coordinator import domain_id
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from pga_me_ros.core.settings import RATES, Settings
from pga_me_ros.core.settings.field import setting
from pga_me_ros.errors import SettingsError
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameters import declare, declare_run, descriptor, on_change

ROOT = Path(__file__).resolve().parents[2]

MakeNode = Callable[..., Node]


@dataclass(frozen=True)
class Speed:
    speed: float = setting(1.0, "How fast.", low=0.0, high=2.0, unit="m/s", rate=True)
    gears: int = setting(5, "How many.", low=1, high=9)


@pytest.fixture
def make_node(monkeypatch: pytest.MonkeyPatch) -> Iterator[MakeNode]:
    """Return a function that makes nodes with command-line arguments, in a separate domain."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    made: list[tuple[Node, Context]] = []

    def make(*arguments: str, name: str = "orchestrator") -> Node:
        context = Context()
        rclpy.init(args=["node", *arguments], context=context, domain_id=domain)
        node = Node(name, context=context, automatically_declare_parameters_from_overrides=True)
        made.append((node, context))
        return node

    with domain_id() as domain:
        yield make
        for node, context in made:
            node.destroy_node()
            context.shutdown()


def ros(*parameters: str) -> list[str]:
    return ["--ros-args"] + [word for p in parameters for word in ("-p", p)]


def test_without_arguments_a_run_has_the_defaults(make_node: MakeNode) -> None:
    settings, options = declare_run(make_node(), RunOptions)
    assert (settings, RunOptions(**options)) == (Settings(), RunOptions())


@pytest.mark.parametrize("task", ["qd_walker", "qd_half_cheetah", "qd_ant", "qd_hopper"])
def test_a_value_given_after_a_shipped_file_counts(make_node: MakeNode, task: str) -> None:
    file = ["--params-file", str(ROOT / "config" / f"{task}.yaml")]
    settings, _ = declare_run(make_node("--ros-args", *file, "-p", "n_evo:=7"), RunOptions)
    assert (settings.task, settings.n_evo) == (task, 7)


def test_the_name_of_an_algorithm_is_enough_and_its_own_defaults_are_shown(
    make_node: MakeNode,
) -> None:
    file = ["--params-file", str(ROOT / "config" / "qd_walker.yaml")]
    node = make_node("--ros-args", *file, "-p", "algorithm:=td3")
    settings, _ = declare_run(node, RunOptions)
    assert settings == Settings(algorithm="td3", task="qd_walker")
    assert node.get_parameter("batch_size").value == settings.batch_size == 10


@pytest.mark.parametrize(
    ("given", "name", "value"),
    [
        ("iso_sigma:=1", "iso_sigma", 1.0),
        ("evaluations:=1e6", "evaluations", 1_000_000),
        ("controller_hidden:=[8, 9]", "controller_hidden", (8, 9)),
    ],
)
def test_numbers_may_be_written_in_common_ways(
    make_node: MakeNode, given: str, name: str, value: Any
) -> None:
    settings, _ = declare_run(make_node(*ros(given)), RunOptions)
    assert getattr(settings, name) == value


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("evaluatons:=5", r"'evaluatons' \(did you mean 'evaluations'\?\); --help lists those"),
        ("evaluations:=abc", "evaluations must be an integer, not 'abc'"),
        ("evaluations:=0", "evaluations is 0; expected"),
        ("run_dir:=2026", "run_dir must be a string, not 2026"),
        ("serve:=1", r"serve must be true or false, not 1 \(int\)"),
        ("n_evo:=101", "n_evo is 101, but a batch has batch_size=100"),
    ],
)
def test_a_bad_parameter_is_refused(make_node: MakeNode, given: str, words: str) -> None:
    node = make_node(*ros(given))
    with pytest.raises(SettingsError, match=words):
        declare_run(node, RunOptions)


def test_each_of_several_paths_is_checked(make_node: MakeNode) -> None:
    many = ", ".join(f"walk_of_seed_{k}" for k in range(40))  # together longer than a name may be
    settings, _ = declare_run(make_node(*ros(f"start_from:='{many}'")), RunOptions)
    assert settings.start_from == many
    node = make_node(*ros(f"start_from:='a, {'b' * 300}'"))
    with pytest.raises(SettingsError, match=r"start_from is 'b{300}', which cannot be reached"):
        declare_run(node, RunOptions)


def test_parameters_of_other_nodes_are_ignored(make_node: MakeNode) -> None:
    node = make_node(*ros("speed:=0.5", "n_evo:=3"))
    assert declare(node, Speed, shared=(Settings,)) == {"speed": 0.5, "gears": 5}
    assert not node.has_parameter("n_evo")


def test_a_name_unknown_to_all_nodes_is_refused(make_node: MakeNode) -> None:
    node = make_node(*ros("sped:=0.5"))
    with pytest.raises(SettingsError, match="did you mean 'speed'"):
        declare(node, Speed, shared=(Settings,))


def test_every_parameter_has_a_description(make_node: MakeNode) -> None:
    node = make_node()
    declare_run(node, RunOptions)
    for kind in (Settings, RunOptions):
        for f in fields(kind):
            told = node.describe_parameter(f.name)
            assert told.description.startswith(f.metadata["description"]), f.name
            assert told.read_only == (f.name not in RATES), f.name


def test_rates_that_come_with_each_request_cannot_be_set(make_node: MakeNode) -> None:
    node = make_node()
    declare_run(node, RunOptions, fixed=True)
    assert all(node.describe_parameter(f.name).read_only for f in fields(Settings))


def test_a_descriptor_has_range_unit_and_symbol() -> None:
    told = descriptor(Settings.__dataclass_fields__["n_crit"])
    assert told.description.endswith(" Symbol: n_crit. Unit: steps.")
    assert (told.integer_range[0].from_value, told.integer_range[0].to_value) == (0, 1_000_000)


def test_a_descriptor_lists_the_choices() -> None:
    told = descriptor(Settings.__dataclass_fields__["archive"])
    assert told.additional_constraints == "one of: cvt, grid"


def test_a_change_is_checked_and_applied(make_node: MakeNode) -> None:
    node = make_node()
    declare(node, Speed)
    handed: list[dict[str, Any]] = []
    on_change(node, lambda changes: None, handed.append)
    node.set_parameters([Parameter("speed", value=0.25)])
    assert handed == [{"speed": 0.25}]


def test_a_refused_change_has_a_reason_and_is_not_applied(make_node: MakeNode) -> None:
    def refuse(changes: dict[str, Any]) -> None:
        raise SettingsError("too fast for today")

    node = make_node()
    declare(node, Speed)
    handed: list[dict[str, Any]] = []
    on_change(node, refuse, handed.append)
    (result,) = node.set_parameters([Parameter("speed", value=0.25)])
    assert (result.successful, result.reason, handed) == (False, "too fast for today", [])


@dataclass(frozen=True)
class Rates:
    sigma: float = setting(0.5, "How far.", low=0.0, high=2.0, rate=True)
    steps: int = setting(5, "How many.", low=1, high=100, rate=True)


@pytest.mark.parametrize(
    ("name", "sent", "value"),
    [("sigma", 1, 1.0), ("sigma", 0, 0.0), ("steps", 7.0, 7), ("steps", 1e2, 100)],
)
def test_a_whole_number_may_be_set_in_either_type(
    make_node: MakeNode, name: str, sent: float, value: float
) -> None:
    node = make_node()
    declare(node, Rates)
    handed: list[dict[str, Any]] = []
    on_change(node, lambda changes: None, handed.append)
    (result,) = node.set_parameters([Parameter(name, value=sent)])
    assert result.successful, result.reason
    assert node.get_parameter(name).value == value
    assert type(node.get_parameter(name).value) is type(value)
    assert handed == [{name: value}]


@pytest.mark.parametrize(
    ("name", "sent"), [("steps", 7.5), ("steps", 1e30), ("sigma", True), ("sigma", 3)]
)
def test_what_would_lose_something_is_refused(make_node: MakeNode, name: str, sent: float) -> None:
    node = make_node()
    declare(node, Rates)
    (result,) = node.set_parameters([Parameter(name, value=sent)])
    assert not result.successful
    assert node.get_parameter(name).value == getattr(Rates(), name)


@pytest.mark.parametrize(("name", "value"), [("gears", 6), ("speed", 3.0), ("speed", "fast")])
def test_rclpy_refuses_what_the_descriptor_forbids(
    make_node: MakeNode, name: str, value: Any
) -> None:
    node = make_node()
    declare(node, Speed)
    (result,) = node.set_parameters([Parameter(name, value=value)])
    assert (result.successful, node.get_parameter(name).value) == (False, getattr(Speed(), name))
