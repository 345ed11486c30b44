"""Our nodes use the transports that the user chooses; two users of one machine need UDP between them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from domain_coordinator import domain_id
from graph import Graph, wait_until
from stored import store

TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
NOBODY = 65534
"""User id without permissions."""

ASK = """
import sys
from pathlib import Path
from pga_me_ros.ros.environment import prepare_environment
prepare_environment()
import rclpy
from pga_me_ros.client import RepertoireClient

rclpy.init()
try:
    print("answer:", RepertoireClient(rclpy.create_node("robot"), timeout=float(sys.argv[1])).get_info().task)
except ValueError as error:
    print(error)
rclpy.shutdown()
"""
"""A robot's node, which joins the graph like all our programs."""

PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="the_users" is_default_profile="true">
    <rtps><builtinTransports>UDPv4</builtinTransports></rtps>
  </participant>
</profiles>
"""


class ChosenGraph(Graph):
    """Nodes with further environment variables, which may belong to another user."""

    chosen: dict[str, str]
    user: tuple[str, ...] = ()

    @property
    def environment(self) -> dict[str, str]:
        words = ("FAST", "RMW_FAST", "ROS_AUTOMATIC", "ROS_LOCALHOST")
        untold = {k: v for k, v in super().environment.items() if not k.startswith(words)}
        return {**untold, "ROS_LOG_DIR": str(self.folder / "ros_logs"), **self.chosen}

    def launch(self, command: list[str]) -> object:
        return super().launch([*self.user, *command])


@pytest.fixture(scope="module")
def repertoire(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stored") / "repertoire.db"
    store(path, 1)
    return path


@pytest.fixture
def user(tmp_path: Path) -> Iterator[Callable[..., ChosenGraph]]:
    """Return a function that makes users of one domain, each with an environment and a user id."""
    made: list[ChosenGraph] = []
    with domain_id() as domain:

        def new(as_user: tuple[str, ...] = (), **chosen: str) -> ChosenGraph:
            folder = tmp_path / f"user-{len(made)}"
            folder.mkdir(parents=True)
            graph = ChosenGraph(domain, folder)
            graph.chosen, graph.user = chosen, as_user
            if as_user:
                # Anybody may pass through, so that the other user can access the folder however deep it is.
                for path in (folder, *folder.parents):
                    if path.stat().st_mode & 0o011 != 0o011:
                        path.chmod(path.stat().st_mode | 0o011)
                os.chown(folder, NOBODY, NOBODY)
            made.append(graph)
            return graph

        yield new
        for graph in made:
            graph.kill()


def serve(graph: ChosenGraph, repertoire: Path) -> int:
    """Start an archive manager, wait until it has joined the graph, and return its process id."""
    shutil.copy(repertoire, graph.folder / "repertoire.db")
    path = graph.folder / "repertoire.db"
    if graph.user:
        os.chown(path, NOBODY, NOBODY)
    manager = graph.start("archive_manager", {"repertoire": path})

    def joined() -> bool:
        assert manager.process.poll() is None, manager.output
        return bool(sockets(manager.process.pid, "udp"))

    wait_until(joined, "the archive manager")
    return manager.process.pid


def ask(graph: ChosenGraph, timeout: float = 40.0) -> str:
    """Request the repertoire's info in a separate process, and return its output."""
    robot = graph.launch([sys.executable, "-c", ASK, str(timeout)])
    assert robot.wait() == 0, robot.output
    return robot.output


def segments(pid: int) -> set[str]:
    """Return the shared memory of Fast DDS that a process has mapped."""
    lines = Path(f"/proc/{pid}/maps").read_text().splitlines()
    return {line.split()[5] for line in lines if "/dev/shm/fastrtps_" in line}


def sockets(pid: int, kind: str) -> set[str]:
    """Return the local addresses of a process's ``udp`` sockets or listening ``tcp`` sockets."""
    links = [os.readlink(fd) for fd in Path(f"/proc/{pid}/fd").iterdir() if fd.is_symlink()]
    inodes = {link[8:-1] for link in links if link.startswith("socket:[")}
    rows = [row.split() for row in Path(f"/proc/{pid}/net/{kind}").read_text().splitlines()[1:]]
    return {row[1] for row in rows if row[9] in inodes and (kind == "udp" or row[3] == "0A")}


@pytest.mark.parametrize(
    ("transports", "shared_memory", "tcp"),
    [(None, True, False), ("UDPv4", False, False), ("LARGE_DATA", True, True)],
)
def test_nodes_use_the_transports_that_the_user_chooses(
    user: Callable[..., ChosenGraph],
    repertoire: Path,
    transports: str | None,
    shared_memory: bool,
    tcp: bool,
) -> None:
    graph = user(**({TRANSPORTS: transports} if transports else {}))
    pid = serve(graph, repertoire)
    assert ask(graph).endswith("answer: qd_walker\n")
    assert (bool(segments(pid)), bool(sockets(pid, "tcp"))) == (shared_memory, tcp)


@pytest.mark.parametrize("where", ["variable", "folder", "environment_file"])
def test_transports_in_a_file_of_the_user_count_too(
    user: Callable[..., ChosenGraph], repertoire: Path, where: str
) -> None:
    graph = user()
    if where == "environment_file":
        (graph.folder / "fastdds.json").write_text(f'{{"{TRANSPORTS}": "UDPv4"}}')
        graph.chosen = {"FASTDDS_ENVIRONMENT_FILE": str(graph.folder / "fastdds.json")}
    else:
        path = graph.folder / "DEFAULT_FASTRTPS_PROFILES.xml"
        path.write_text(PROFILE)
        graph.chosen = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(path)} if where == "variable" else {}
    pid = serve(graph, repertoire)
    assert ask(graph).endswith("answer: qd_walker\n")
    assert not segments(pid)


def test_the_older_way_to_stay_on_this_machine_counts(
    user: Callable[..., ChosenGraph], repertoire: Path
) -> None:
    graph = user(ROS_LOCALHOST_ONLY="1")
    serve(graph, repertoire)
    assert ask(graph).endswith("answer: qd_walker\n")


@pytest.fixture
def another_user(tmp_path: Path) -> tuple[str, ...]:
    """Return a command prefix that runs a program as another user, who may read our files wherever they are."""
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        pytest.skip("acting as another user needs root and setpriv")
    command = ("setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups")
    command += ("--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search")
    tried = subprocess.run([*command, sys.executable, "-c", ""], capture_output=True, text=True)
    if tried.returncode:
        pytest.skip(f"root may not act as another user on this machine: {tried.stderr.strip()}")
    return command


@pytest.mark.parametrize("side", ["server", "robot"])
def test_two_users_reach_each_other_by_udp_if_one_of_them_chooses_it(
    user: Callable[..., ChosenGraph], another_user: tuple[str, ...], repertoire: Path, side: str
) -> None:
    udp = {TRANSPORTS: "UDPv4"}
    serve(user(another_user, **udp if side == "server" else {}), repertoire)
    assert ask(user(**udp if side == "robot" else {})) == "answer: qd_walker\n"


def test_the_error_for_an_unreachable_node_of_another_user_says_what_to_do(
    user: Callable[..., ChosenGraph], another_user: tuple[str, ...], repertoire: Path
) -> None:
    serve(user(another_user), repertoire)
    told = ask(user(), timeout=8.0)
    assert "Other users run ROS 2 nodes on this machine" in told
    assert f"export {TRANSPORTS}=UDPv4" in told
    assert "Other users" not in ask(user(**{TRANSPORTS: "UDPv4"}))
