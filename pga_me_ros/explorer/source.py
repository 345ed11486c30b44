"""What the live page shows: a repertoire on disk, or one that a graph serves."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from pga_me_ros.core.archive.choosing import NotFoundError
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.storage.reevaluations import FILE
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import PgaError, RequestError
from pga_me_ros.explorer.description import describe
from pga_me_ros.player.gait import Gait

FORMATS = {"onnx": ".onnx", "npz": ".npz", "torchscript": ".pt"}
"""Formats in which a gait can be downloaded, and the suffix of the file."""


def replaced(cell: int) -> RequestError:
    """Return the error that a cell has another gait than the page shows."""
    return RequestError(f"The gait of cell {cell} was replaced since; the map is being updated.")


def require_shown(gait: Gait, evaluation: int) -> None:
    """Make sure that a gait is still the one that the page shows.

    Args:
        gait: The gait of a cell now.
        evaluation: Id of the evaluation of the one that is shown.

    Raises:
        RequestError: It has another evaluation.
    """
    if gait.evaluation != evaluation:
        raise replaced(gait.cell)


class Source(Protocol):
    """A repertoire to show. One thread calls `refresh`, another `gait` and `download`, a third `control`.

    Attributes:
        version: Grows whenever `content` changes.
        content: What the page shows, see `description.describe`.
        settings: Settings of the run.
        problem: What is wrong at the moment, in words for the page; empty if nothing is.
    """

    version: int
    content: dict[str, Any]
    settings: Settings
    problem: str

    def refresh(self) -> None:
        """Look whether the repertoire has changed; what goes wrong becomes `problem`."""
        ...

    def state(self) -> dict[str, Any] | None:
        """Return how the run is going, None where no graph is there."""
        ...

    def gait(self, cell: int) -> Gait:
        """Return the gait of a cell.

        Raises:
            PgaError: There is none, or nobody answers.
        """
        ...

    def download(self, cell: int, evaluation: int, kind: str) -> bytes:
        """Return the gait of a cell as a file in one of `FORMATS`.

        Raises:
            PgaError: There is no such gait, its evaluation is another one, or the format needs a package that is
                missing.
        """
        ...

    def control(self, action: str, values: dict[str, Any]) -> str:
        """Pause, resume or stop the run, or change its rates; returns what came of it.

        Raises:
            PgaError: It was refused, or there is no graph.
        """
        ...

    def close(self) -> None:
        """Give back what was opened."""
        ...


class StoredSource:
    """A repertoire on disk, read again whenever its files change.

    Args:
        path: As for `StoredRun.load`.
        name: What the user calls it.

    Attributes:
        run: The run as it was last read.

    Raises:
        StorageError: There is no run, it is damaged, or it holds no behavior yet.
    """

    def __init__(self, path: Path, name: str) -> None:
        self._path, self._name = path, name
        self.version = 0
        self.problem = ""
        self.run = StoredRun.load(path)
        self._stamp = self._stamp_now()
        self.settings = self.run.settings
        self.content = self._described()

    def refresh(self) -> None:
        """See `Source`."""
        stamp = self._stamp_now()
        if stamp == self._stamp and not self.problem:
            return
        try:
            run = StoredRun.load(self._path)
            _require_same(run.settings, self.settings)
        except (PgaError, OSError) as error:
            self.problem = f"{error} The page shows the last state that could be read."
            return
        self.run, self._stamp, self.problem = run, stamp, ""
        self.content = self._described()
        self.version += 1

    def state(self) -> dict[str, Any] | None:
        """See `Source`."""
        return None

    def gait(self, cell: int) -> Gait:
        """See `Source`."""
        return self.run.behavior(cell)

    def download(self, cell: int, evaluation: int, kind: str) -> bytes:
        """See `Source`."""
        from pga_me_ros.export.__main__ import export_evaluation

        with TemporaryDirectory() as folder:
            out = Path(folder) / f"gait{FORMATS[kind]}"
            try:
                export_evaluation(self._path, kind, evaluation, out)
            except NotFoundError:  # the file may be newer than what is shown
                raise replaced(cell) from None
            return out.read_bytes()

    def control(self, action: str, values: dict[str, Any]) -> str:
        """See `Source`."""
        raise RequestError(
            "This page shows a stored run; open the page of its graph to control it."
        )

    def close(self) -> None:
        """See `Source`."""

    def _described(self) -> dict[str, Any]:
        return describe(self.run, self._name)

    def _stamp_now(self) -> tuple[tuple[int, int] | None, ...]:
        """Return time and size of each file that the page depends on."""
        file = self.run.file
        stamps: list[tuple[int, int] | None] = []
        for path in (file, Path(f"{file}-wal"), file.with_name(FILE)):
            try:
                found = path.stat()
                stamps.append((found.st_mtime_ns, found.st_size))
            except OSError:
                stamps.append(None)
        return tuple(stamps)


def _require_same(found: Settings, shown: Settings) -> None:
    """Make sure that motions are still simulated as the run would.

    Raises:
        RequestError: Another run has taken the place of the one that is shown.
    """
    for name in ("task", "seed", "randomization"):
        if getattr(found, name) != getattr(shown, name):
            raise RequestError("Another run has taken its place; restart the explorer to see it.")
