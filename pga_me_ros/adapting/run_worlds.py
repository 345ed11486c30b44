"""The worlds that a robot of a run's repertoire may be in, read from the run's folder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from pga_me_ros.core.archive.worlds import Worlds
from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError


@dataclass(frozen=True, eq=False)
class RunWorlds:
    """Worlds, and the run whose behaviors they tell of.

    Attributes:
        path: Folder or name that they were read from.
        run_id: The run.
        worlds: The worlds.
    """

    path: str
    run_id: str
    worlds: Worlds

    @classmethod
    def load(cls, path: str) -> Self:
        """Read the worlds of a run.

        Args:
            path: Folder of the run, its repertoire file, or ``zoo/NAME``.

        Raises:
            StorageError: There is no run.
            RequestError: Its elites were not evaluated in another world.
        """
        run = StoredRun.load(path, elites=False)
        return cls(path, run.info.run_id, run.require_worlds(f"worlds is '{path}'"))

    def of(self, run_id: str) -> Worlds:
        """Return the worlds of the run that is served.

        Raises:
            RequestError: They are of another run.
        """
        if run_id != self.run_id:
            raise RequestError(
                f"Run {run_id} is served, but the parameter worlds names '{self.path}', which is run {self.run_id}; "
                "serve that one, or start the adapter with the worlds of the run that is served."
            )
        return self.worlds
