"""What ``make run`` does after the setup: grow, request from another process, run, compare."""

from __future__ import annotations

import signal
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from domain_coordinator import domain_id
from graph import TINY, Graph, Probe, Started, ros_arguments, wait_until
from pga_me_msgs.msg import Behavior
from pga_me_msgs.srv import GetInfo
from stored import store

from pga_me_ros.client import ListedBehavior, RepertoireInfo
from pga_me_ros.demo.arguments import DEFAULTS, Arguments, find_config
from pga_me_ros.demo.robot import convinces, served_from, unlike_the_fittest
from pga_me_ros.errors import SettingsError

CONFIG = Path(__file__).resolve().parents[2] / "config" / "qd_walker.yaml"


def demonstrate(graph: Graph, run_dir: Path, *more: str, **parameters: Any) -> Started:
    """Start the demonstration of a tiny run; it decides whether the orchestrator keeps serving.

    The algorithm is named by a file: were that overridden by the default, `TINY` would be refused. So is the folder.
    """
    file = Path(f"{run_dir}.yaml")  # `processes_of` knows them by this name
    named = f"task: qd_walker, algorithm: pga_map_elites, run_dir: '{run_dir}'"
    file.write_text(f"/**: {{ros__parameters: {{{named}}}}}\n")
    values = {**TINY, **parameters}
    words = ["--params-file", str(file), *ros_arguments(values)[1:], *more]
    return graph.launch([sys.executable, "-m", "pga_me_ros.demo", *words])


def processes_of(run_dir: Path) -> list[str]:
    """Return the command lines of a run's living processes."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:  # it has ended
            continue
        if str(run_dir) in line:
            found.append(line)
    return found


@dataclass
class Twice:
    """Two demonstrations with the same command."""

    run_dir: Path
    codes: list[int]
    outputs: list[str]


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> Twice:
    folder = tmp_path_factory.mktemp("demo")
    done = Twice(folder / "run", [], [])
    with domain_id() as domain:
        graph = Graph(domain, folder)
        try:
            for _ in range(2):
                demo = demonstrate(graph, done.run_dir, "-r", "__ns:=/demo")
                done.codes.append(demo.wait(120.0))
                done.outputs.append(demo.output)
        finally:
            graph.kill()
    return done


@pytest.mark.slow
def test_a_robot_in_another_process_gets_what_was_promised(twice: Twice) -> None:
    assert twice.codes[0] == 0, twice.outputs[0]
    rows = [line.split() for line in twice.outputs[0].splitlines()]
    promised = [row[1:] for row in rows if row[:1] == ["promised"]]
    same_start = [row[3:-1] for row in rows if row[:3] == ["achieved,", "same", "start"]]
    assert len(promised) == 3
    assert promised[:2] == same_start


@pytest.mark.slow
def test_a_run_without_a_gait_that_lasts_ends_with_one_that_comes_with_the_package(
    twice: Twice,
) -> None:
    own, told, ready = twice.outputs[0].partition("this one comes with the package: zoo/qd_walker")
    assert told, twice.outputs[0]
    assert "none of them falls in at most 5%" in own
    rows = [line.split() for line in ready.splitlines()]
    (promised,) = [row for row in rows if row[:1] == ["promised"]]
    (achieved,) = [row for row in rows if row[:1] == ["achieved,"]]
    assert float(achieved[5]) >= 0.9 * float(promised[2])
    assert "-p repertoire:=zoo/qd_walker\n" in ready
    assert "render zoo/qd_walker --descriptor " in ready


def test_the_robot_knows_the_folder_of_what_is_served(
    graph: Graph, probe: Probe, tmp_path: Path
) -> None:
    store(tmp_path / "run" / "repertoire.db")
    graph.start("archive_manager", {"repertoire": str(tmp_path / "run")})
    assert served_from(probe.node) == str(tmp_path / "run")


@pytest.mark.slow
def test_the_second_time_the_repertoire_exists(twice: Twice) -> None:
    assert twice.codes[1] == 0, twice.outputs[1]
    assert "has already reached its budget" in twice.outputs[1]
    assert twice.outputs[1].count("equal") == 2


@pytest.mark.slow
def test_no_process_is_left_behind(twice: Twice) -> None:
    assert not processes_of(twice.run_dir)


@pytest.mark.slow
def test_ctrl_c_ends_it_with_all_its_processes(graph: Graph, tmp_path: Path) -> None:
    demo = demonstrate(graph, tmp_path / "run", evaluations=100_000)
    demo.wait_for_output("evaluations 10/")
    demo.signal(signal.SIGINT)
    assert demo.wait() == 0, demo.output
    assert "Traceback" not in demo.output
    assert "the same command resumes" in demo.output
    assert not processes_of(tmp_path / "run")


@pytest.mark.slow
def test_no_process_survives_a_killed_demonstration(graph: Graph, tmp_path: Path) -> None:
    run_dir = tmp_path / "run"
    demo = demonstrate(graph, run_dir, evaluations=100_000)
    demo.wait_for_output("evaluations 10/")
    assert processes_of(run_dir)
    demo.signal(signal.SIGKILL)
    demo.wait()
    wait_until(lambda: not processes_of(run_dir), "the end of all processes", 20.0)


def listed(descriptor: list[float], mean: list[float], fitness: float = 80.0) -> ListedBehavior:
    msg = Behavior(
        descriptor=descriptor, mean_descriptor=mean, repeats=5 * bool(mean), by_mean=bool(mean)
    )
    msg.fitness = msg.mean_fitness = fitness
    return ListedBehavior.from_msg(msg)


def test_the_next_gait_to_ask_for_is_fit_and_differs_most_from_the_fittest() -> None:
    info = RepertoireInfo.from_response(
        GetInfo.Response(
            descriptor_low=[0.0, -10.0], descriptor_high=[1.0, 90.0], settings="{}", versions="{}"
        )
    )
    fittest, slow = listed([0.9, 0.0], [0.5, 0.0], 100.0), listed([0.0, 90.0], [], 70.0)
    others = [listed([0.5, 40.0], []), listed([0.5, 0.0], [0.9, 2.0]), listed([0.95, 0.0], [])]
    np.testing.assert_array_equal(unlike_the_fittest([fittest, *others, slow], info), [0.95, 0.0])
    np.testing.assert_array_equal(unlike_the_fittest([fittest], info), [0.5, 0.0])
    assert unlike_the_fittest([], info) is None


@pytest.mark.parametrize(
    ("own", "ready", "enough"),
    [
        pytest.param(None, 2200.0, False, id="all hoppers fall"),
        pytest.param(1009.0, 2200.0, False, id="a hopper stands"),
        pytest.param(1342.0, 2200.0, True, id="a hopper hops"),
        pytest.param(1000.0, 1837.0, False, id="a walker stands"),
    ],
)
def test_a_robot_that_stands_still_does_not_convince(
    own: float | None, ready: float, enough: bool
) -> None:
    behavior = None if own is None else listed([0.5], [0.5], own)
    assert convinces(behavior, listed([0.5], [0.5], ready)) == enough


def test_a_misspelled_task_gives_one_line_with_the_nearest_name(graph: Graph) -> None:
    words = ["--params-file", "config/qd_wlker.yaml"]
    demo = graph.launch([sys.executable, "-m", "pga_me_ros.demo", *words])
    assert demo.wait() == 2
    (line,) = demo.output.splitlines()
    assert "no params file 'config/qd_wlker.yaml' (did you mean 'qd_walker'?)" in line


def test_a_file_and_the_user_override_the_defaults() -> None:
    words = ["--params-file", str(CONFIG), "-p", "evaluations:=7", "-p", "seed:=1"]
    arguments = Arguments.parse(words).orchestrator
    defaults = [word for value in DEFAULTS for word in ("-p", value)]
    assert arguments == ["--ros-args", *defaults, *words, "-p", "serve:=true"]


def test_a_namespace_reaches_the_robot_too() -> None:
    words = ["--params-file", str(CONFIG), "-r", "__ns:=/left", "-p", "serve:=true"]
    arguments = Arguments.parse(words)
    assert (arguments.remaps, arguments.serve) == (["-r", "__ns:=/left"], True)


def test_configurations_are_found_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_config("config/qd_walker.yaml").samefile(CONFIG)


def test_the_users_own_file_takes_precedence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "qd_walker.yaml"
    own.write_text("/**: {ros__parameters: {seed: 1}}\n")
    assert find_config("qd_walker.yaml").resolve() == own


def test_a_full_path_that_does_not_exist_is_not_replaced(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="no params file"):
        find_config(str(tmp_path / "qd_walker.yaml"))
