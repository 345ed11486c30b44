"""What a repertoire file says about its run; enough to use its controllers."""

from __future__ import annotations

import json
import platform
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from pga_me_ros.core.networks.shapes import controller_shape
from pga_me_ros.core.settings import Settings, identity_difference
from pga_me_ros.errors import StorageError
from pga_me_ros.tasks.spec import OPTIONAL_FIELDS, TaskSpec

SCHEMA_VERSION = 2
"""Version of the repertoire file's layout. In version 1, a CVT archive measured distances to its centroids in the
descriptor's units; since version 2, in shares of its range."""

READABLE_VERSIONS = (1, SCHEMA_VERSION)

LIBRARIES = ("numpy", "torch", "pybullet")


@dataclass(frozen=True)
class RunInfo:
    """Identity of a run: plain JSON, so that readers need none of its software.

    Attributes:
        run_id: UUID of the run.
        settings: `Settings.to_dict()` of its first start; rates are stored with each generation.
        task: `TaskSpec.to_json()`: names, units, limits of observations, actions, descriptors.
        layer_sizes: Sizes of the controllers' layers, from observation to action.
        activations: Activation after each layer but the first, for example ``("relu", "tanh")``.
        versions: Versions of the libraries that computed the run.
        created: Time of creation, ISO 8601 in UTC.
        schema_version: Version of the file's layout.
    """

    run_id: str
    settings: Mapping[str, Any]
    task: Mapping[str, Any]
    layer_sizes: tuple[int, ...]
    activations: tuple[str, ...]
    versions: Mapping[str, str]
    created: str
    schema_version: int = SCHEMA_VERSION

    @classmethod
    def of_new_run(cls, spec: TaskSpec, settings: Settings) -> RunInfo:
        """Return the description of a new run, with a new id.

        Args:
            spec: Its task.
            settings: Its settings.
        """
        shape = controller_shape(spec, settings)
        return cls(
            run_id=str(uuid.uuid4()),
            settings=settings.to_dict(),
            task=spec.to_json(),
            layer_sizes=shape.sizes,
            activations=("relu",) * (len(shape.sizes) - 2) + ("tanh",),
            versions=library_versions(),
            created=datetime.now(UTC).isoformat(timespec="seconds"),
        )

    def to_json(self) -> str:
        """Return all of it as a JSON object with sorted keys."""
        return json.dumps(vars(self), sort_keys=True, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> RunInfo:
        """Return what `to_json` wrote.

        Raises:
            StorageError: The text is not what `to_json` writes.
        """
        try:
            fields = json.loads(text)
            fields["layer_sizes"] = tuple(fields["layer_sizes"])
            fields["activations"] = tuple(fields["activations"])
            return cls(**fields)
        except (ValueError, TypeError, KeyError) as error:
            raise StorageError(
                f"The run's description cannot be read ({error}); restore the file from a copy."
            ) from None

    def require(self, settings: Settings, task: Mapping[str, Any]) -> None:
        """Make sure that a run may be resumed with these settings and this task.

        Rates and the budget may differ.

        Raises:
            StorageError: The task, or a setting that decides the result, differs.
        """
        own = Settings.from_stored(self.settings)
        found = identity_difference(_with_cells(own, self.task), _with_cells(settings, task))
        ours = json.loads(json.dumps(self.task))
        theirs = json.loads(json.dumps(dict(task)))
        if ours.get("name") == theirs.get("name"):
            changed = changed_fields(ours, theirs)
            found += [f"{name} of the task's spec has changed" for name in changed]
        elif not any(difference.startswith("task:") for difference in found):
            found.append(f"task name: {ours.get('name')} != {theirs.get('name')}")
        if found:
            raise StorageError(
                "The repertoire belongs to a run with other settings (its own != yours): "
                f"{'; '.join(found)}. Start it with its own settings or choose another folder."
            )

    def version_differences(self, versions: Mapping[str, str]) -> list[str]:
        """Return the libraries that differ, each as ``"name: ours != theirs"``.

        Other versions may change the result of a resumed run.
        """
        names = sorted(self.versions.keys() | versions.keys())
        pairs = [(n, self.versions.get(n, "none"), versions.get(n, "none")) for n in names]
        return [f"{name}: {a} != {b}" for name, a, b in pairs if a != b]


def library_versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that compute results, without importing them."""
    found = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found


def changed_fields(stored: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return the fields in which a task's spec differs from that of a run.

    Args:
        stored: `TaskSpec.to_json()` of the run, read back from JSON. A field that is missing because the version that
            wrote it did not have it does not count.
        now: That of the task now, in the same form.
    """
    added = OPTIONAL_FIELDS - stored.keys()
    names = sorted((stored.keys() | now.keys()) - added)
    return [name for name in names if stored.get(name) != now.get(name)]


def _with_cells(settings: Settings, task: Mapping[str, Any]) -> Settings:
    """Return settings with 0 cells replaced by the task's own number."""
    if settings.archive == "grid":
        return settings
    return settings.replace(cells=settings.cells or task.get("archive_cells", 0))
