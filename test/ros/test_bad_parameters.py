"""Invalid parameters and logging variables: exit code 2 and one line that names them, for any node."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from domain_coordinator import domain_id
from parameter_fuzz import NODES, bad_values

from pga_me_ros.core.archive.elite_table import EliteTable
from pga_me_ros.core.runs.memory_need import require_memory
from pga_me_ros.core.settings import Settings
from pga_me_ros.errors import ArchiveError, SettingsError
from pga_me_ros.ros.command_line import check
from pga_me_ros.ros.environment import prepare_environment
from pga_me_ros.ros.process import report
from pga_me_ros.tasks.registry import task_spec

FUZZ = Path(__file__).with_name("parameter_fuzz.py")
ORCHESTRATOR = NODES["orchestrator"][0]


def test_every_parameter_of_every_node_refuses_bad_values_in_one_line() -> None:
    with domain_id() as domain:
        done = subprocess.run(
            [sys.executable, FUZZ, "--short"],
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            capture_output=True,
            text=True,
        )
    assert done.returncode == 0, done.stdout + done.stderr
    parameters = {
        f.name for program, _, _ in NODES.values() for k in program.parameters for f in fields(k)
    }
    assert int(done.stdout.splitlines()[-1].split()[0]) > len(parameters)


def test_every_parameter_has_invalid_values() -> None:
    for program, _, _ in NODES.values():
        for kind in program.parameters:
            assert all(len(list(bad_values(f))) >= 3 for f in fields(kind))


@pytest.mark.parametrize("empty", ["[]", "[ ]", "orchestrator:seed:=[]"])
def test_empty_lists_are_named_on_the_command_line(empty: str) -> None:
    given = empty if ":=" in empty else f"seed:={empty}"
    with pytest.raises(SettingsError, match=r"^seed is an empty list"):
        check(ORCHESTRATOR, ["--ros-args", "-p", given])


@pytest.mark.parametrize(
    ("section", "refused"), [("/**", True), ("orchestrator", True), ("other", False)]
)
def test_empty_lists_are_named_in_params_files_of_this_node(
    tmp_path: Path, section: str, refused: bool
) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(
        f"{section}:\n  ros__parameters:\n    critic_hidden: []\n"
        "/*:\n  ros__parameters:\n    seed: 1\n"
    )
    arguments = ["--ros-args", "--params-file", str(file)]
    if not refused:
        check(ORCHESTRATOR, arguments)
        return
    with pytest.raises(SettingsError, match=r"^critic_hidden is an empty list"):
        check(ORCHESTRATOR, arguments)


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"controller_hidden": (65536, 65536)}, "controller_hidden or batch_size"),
        ({"critic_hidden": (65536,) * 12}, "critic_hidden"),
    ],
)
def test_networks_that_memory_cannot_hold_are_refused(given: dict, named: str) -> None:
    spec = task_spec("qd_hopper")
    require_memory(spec, Settings())
    with pytest.raises(SettingsError, match=f"give smaller {named}"):
        require_memory(spec, Settings(**given))


def test_an_archive_that_memory_cannot_hold_is_refused() -> None:
    with pytest.raises(ArchiveError, match="34359738 GB, which memory cannot hold; give"):
        EliteTable(1_000_000, 2, 2**33, np.ones(2))
    with pytest.raises(ArchiveError, match="memory cannot hold"):
        EliteTable(1000, 2, 2**60, np.ones(2))


def test_errors_of_memory_or_disk_at_the_start_are_reported_in_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for error in (MemoryError("Unable to allocate\n1 TiB"), PermissionError(13, "no", "/a/b")):
        assert report(error) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("error: ")
        assert report(error, starting=False) == 1  # an internal fault: reported in full
        assert type(error).__name__ in capsys.readouterr().err


@pytest.mark.parametrize(
    "variable",
    ["RCUTILS_COLORIZED_OUTPUT", "RCUTILS_LOGGING_BUFFERED_STREAM", "RCUTILS_LOGGING_USE_STDOUT"],
)
def test_logging_variables_that_would_end_ros_2_are_refused(variable: str) -> None:
    prepare_environment({variable: "1"})
    with pytest.raises(SettingsError, match=f"^{variable} is 'yes'; expected 0 or 1"):
        prepare_environment({variable: "yes"})


def test_a_log_folder_that_cannot_be_written_is_reported_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for variables in ({"RCUTILS_LOGGING_USE_STDOUT": "abc"}, {"ROS_LOG_DIR": "/proc"}):
        ended = subprocess.run(
            [sys.executable, "-m", "pga_me_ros.nodes.archive_manager"],
            env={**os.environ, **variables},
            capture_output=True,
            text=True,
        )
        assert ended.returncode == 2, ended.stderr
        (line,) = ended.stderr.splitlines()
        assert line.startswith("error: ")


@pytest.mark.parametrize("domain", ["233", "1000", "99999999999999", "-1", "abc", "1.5", "٣"])
def test_a_domain_that_does_not_exist_is_named(domain: str) -> None:
    with pytest.raises(SettingsError, match=f"^ROS_DOMAIN_ID is '{domain}'; expected .* 0 to 232"):
        prepare_environment({"ROS_DOMAIN_ID": domain})


@pytest.mark.parametrize("domain", ["0", "232", ""])
def test_a_domain_that_exists_is_accepted(domain: str) -> None:
    prepare_environment({"ROS_DOMAIN_ID": domain})
