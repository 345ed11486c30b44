"""Command lines, without starting ROS 2."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context

from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import SettingsError
from pga_me_ros.player.settings import PlayerSettings
from pga_me_ros.ros.choice import ChoiceSettings
from pga_me_ros.ros.command_line import Program, check, node_name, remappings, start
from pga_me_ros.ros.options import RunOptions
from pga_me_ros.ros.parameter_help import parameter_list, parameter_table

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from parameter_docs import page

PROGRAM = Program("orchestrator", "Leads.", (Settings, RunOptions))
PLAYER = Program("behavior_player", "Plays.", (ChoiceSettings, PlayerSettings))
ASKER = Program("query", "Asks.", ())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("--hlep", r"'--hlep' \(did you mean '--help'\?\); parameters come after --ros-args"),
        ("-p task:=qd_ant", "Unknown argument '-p'; .*orchestrator --ros-args -p NAME:=VALUE"),
        ("task:=qd_ant", "Unknown argument 'task:=qd_ant'"),
        ("--rosargs -p task:=qd_ant", r"did you mean '--ros-args'\?"),
        ("--ros-args -p task:=qd_ant -- qd_walker", "Unknown argument 'qd_walker'"),
    ],
)
def test_other_than_ros_arguments_are_refused(arguments: str, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        check(PROGRAM, arguments.split())


@pytest.mark.parametrize(
    ("program", "given", "words"),
    [
        (ASKER, "-p rate:=100", "'-p rate:=100' has no effect: query has no parameters; leave"),
        (ASKER, "--param query:rate:=100", "query has no parameters"),
        (ASKER, "--params-file any.yaml", "'--params-file any.yaml' has no effect"),
        (PLAYER, "-p run_dir:=a -p seed:=7", r"^Unknown parameter 'seed'.*'behavior_player'"),
        (PLAYER, "-p randomization:=a:=b", "Unknown parameter 'randomization'"),
        (
            PLAYER,
            "-p orchestrator:speed:=2",
            "is for a node '/orchestrator', and this one is '/behavior_player'; leave",
        ),
        (PROGRAM, "-p critic_trainer:seed:=2", "leave out 'critic_trainer:' if you mean this one"),
        (PROGRAM, "-p orchestrator:seed:=2 -r __ns:=/a", "this one is '/a/orchestrator'"),
        (PROGRAM, "-p orchestrator:seed:=2 -r __node:=boss", "this one is '/boss'"),
        (PROGRAM, "-p sead:=7", r"Unknown parameter 'sead' \(did you mean 'seed'\?\)"),
    ],
)
def test_parameters_that_the_program_does_not_have_are_refused(
    program: Program, given: str, words: str
) -> None:
    with pytest.raises(SettingsError, match=words):
        check(program, ["--ros-args", *given.split()])


def test_a_program_without_parameters_has_no_help_of_them() -> None:
    with pytest.raises(SettingsError, match="Unknown ROS argument '--help'"):
        start(ASKER, ["--ros-args", "--help"])


@pytest.mark.parametrize(
    ("program", "arguments"),
    [
        (PROGRAM, ""),
        (PROGRAM, "--ros-args"),
        (PROGRAM, "--ros-args -p task:=qd_ant -r a:=b --"),
        (PROGRAM, "--ros-args -p task"),  # which rcl refuses
        (PLAYER, "--ros-args -p behavior_player:speed:=2.0"),
        (PLAYER, "--ros-args -r __node:=robot -p robot:speed:=2.0"),
        (ASKER, "--ros-args -r __ns:=/a -p use_sim_time:=true -p qos_overrides./a.depth:=1"),
    ],
)
def test_ros_arguments_are_accepted(program: Program, arguments: str) -> None:
    check(program, arguments.split())


def test_a_params_file_may_hold_parameters_of_other_nodes(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("/**: {ros__parameters: {seed: 1}}\n")
    check(PLAYER, ["--ros-args", "--params-file", str(path)])


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ("", "/orchestrator"),
        ("--ros-args -r __ns:=/a/b", "/a/b/orchestrator"),
        ("--ros-args --remap __node:=boss -r __ns:=/", "/boss"),
        ("--ros-args -r orchestrator:__name:=boss", "/boss"),
    ],
)
def test_a_node_has_the_name_it_is_remapped_to(arguments: str, name: str) -> None:
    assert node_name(PROGRAM, arguments.split()) == name


def test_other_nodes_get_renamed_topics_and_services_but_not_node_names() -> None:
    words = "--ros-args -r __ns:=/a -r a/b:=c --remap boss:d:=/e -p seed:=1 -r boss:__node:=f"
    assert remappings(words.split()) == ["-r", "a/b:=c", "--remap", "boss:d:=/e"]


def test_a_params_file_for_other_nodes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text("/a/orchestrator: {ros__parameters: {seed: 1}}\n")
    check(PROGRAM, ["--ros-args", "--params-file", str(path), "-r", "__ns:=/a"])
    with pytest.raises(SettingsError, match="nothing for node '/orchestrator', only for /a/orch"):
        check(PROGRAM, ["--ros-args", "--params-file", str(path)])


@pytest.mark.parametrize("arguments", ["-h", "--help", "--nonsense --help"])
def test_help_is_printed_without_starting_ros(
    arguments: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not start(PROGRAM, arguments.split())
    assert capsys.readouterr().out == PROGRAM.help()


def test_help_describes_a_parameter_completely() -> None:
    assert (
        "  n_evo* = -1 offspring; -1 to 100000; paper: n_evo\n"
        "      Offspring per generation by genetic variation; batch_size: standard MAP-Elites, 0: policy\n"
        "      gradients only, -1: the algorithm's own number (half the batch).\n"
    ) in parameter_list(Settings)


def test_the_table_describes_a_parameter_completely() -> None:
    assert (
        "| `archive` | `cvt` | cvt or grid | | | | Cells: 'cvt' is a centroidal Voronoi "
        "tessellation (as coded by the authors), 'grid' has equal bins per dimension (as the paper "
        "words it). |\n"
    ) in parameter_table(Settings)


def test_the_page_of_parameters_is_up_to_date() -> None:
    path = Path(__file__).resolve().parents[2] / "docs" / "parameters.md"
    assert path.read_text() == page(), "python scripts/parameter_docs.py > docs/parameters.md"


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        ("__ns:=/my-robot", "Namespace '/my-robot' has a '-', .*expected -r __ns:=/my_robot$"),
        ("__ns:=/left/", "Namespace '/left/' ends with a slash; expected -r __ns:=/left$"),
        ("__ns:=left", "Namespace 'left' does not begin with a slash; expected -r __ns:=/left$"),
        ("__ns:=/a//b", "has two slashes in a row; expected -r __ns:=/a/b$"),
        ("__ns:=/1st", "no digit first; expected -r __ns:=/_1st$"),
        ("__ns:=/a__b", "single underscores only, .*expected -r __ns:=/a_b$"),
        ("__ns:=", "Namespace '' .*expected -r __ns:=/$"),
        ("__node:=my-node", "Node name 'my-node' has a '-', .*expected -r __node:=my_node$"),
        ("boss:__name:=a/b", "Node name 'a/b' is no single name; expected -r __name:=a_b$"),
    ],
)
def test_an_invalid_name_is_reported_with_a_valid_one(rule: str, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        check(PROGRAM, ["--ros-args", "-r", rule])


@pytest.mark.parametrize("rule", ["__ns:=/a/_b", "__ns:=/", "__ns:=/a_", "__node:=a_", "a:=b/c"])
def test_a_valid_name_is_accepted_as_by_ros(rule: str) -> None:
    check(PROGRAM, ["--ros-args", "-r", rule])
    context = Context()
    rclpy.init(args=["x", "--ros-args", "-r", rule], context=context)
    context.shutdown()
