"""The command line of the demonstration: arguments of the orchestrator and of the robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from pga_me_ros.errors import SettingsError, nearest_name
from pga_me_ros.paths import user_path

DEFAULTS = ("algorithm:=dcrl_map_elites", "evaluations:=7680", "reevaluations:=3")
"""What a short run is best made with: the algorithm that learns fastest, and minutes of the hopper on two cores."""


@dataclass(frozen=True)
class Arguments:
    """The parsed command line.

    Attributes:
        orchestrator: ROS arguments of the orchestrator.
        remaps: Those of them that rename; the robot needs them, too, to find the repertoire.
        serve: Whether the user wants the repertoire to be served afterwards.
    """

    orchestrator: list[str]
    remaps: list[str]
    serve: bool

    @classmethod
    def parse(cls, words: Sequence[str]) -> Arguments:
        """Read the command line.

        Raises:
            SettingsError: A params file does not exist.
        """
        given = [word for word in words if word != "--ros-args"]
        remaps: list[str] = []
        for i, (flag, value) in enumerate(pairwise(given), start=1):
            if flag == "--params-file":
                given[i] = str(find_config(value))
            elif flag in ("-r", "--remap"):
                remaps += [flag, value]
        # Of two values, the later one counts: what a file or the user says is not overridden.
        defaults = [word for value in DEFAULTS for word in ("-p", value)]
        serve = "serve:=true" in given
        return cls(["--ros-args", *defaults, *given, "-p", "serve:=true"], remaps, serve)


def find_config(given: str) -> Path:
    """Return a params file: the given one, or one with the same name among the supplied configurations.

    Raises:
        SettingsError: There is no such file.
    """
    path = user_path(given)
    if path.is_file():
        return path
    known: dict[str, Path] = {}
    for folder in _config_folders():  # the first folder that has it counts
        for file in sorted(folder.glob("*.yaml")):
            known.setdefault(file.stem, file)
    if path.stem in known and not path.is_absolute():
        return known[path.stem]
    raise SettingsError(
        f"There is no params file '{given}'{nearest_name(path.stem, known)}; there are configurations for "
        f"{', '.join(known) or 'no task'} (make run TASK=NAME)."
    )


def _config_folders() -> Iterator[Path]:
    checkout = Path(__file__).resolve().parents[2] / "config"
    if checkout.is_dir():
        yield checkout
    from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

    with suppress(PackageNotFoundError):
        yield Path(get_package_share_directory("pga_me_ros")) / "config"
