"""Several stored runs, each given once."""

from __future__ import annotations

from collections.abc import Iterable

from pga_me_ros.core.storage.stored_run import StoredRun
from pga_me_ros.errors import RequestError


def require_distinct(runs: Iterable[StoredRun]) -> None:
    """Make sure that no run is given twice. Different parts of a run, by `thin`, may be given.

    Raises:
        RequestError: Two are the same run.
    """
    seen: dict[object, StoredRun] = {}
    for run in runs:
        which = run.file.resolve() if run.is_thinned else run.info.run_id
        other = seen.setdefault(which, run)
        if other is not run:
            raise RequestError(f"'{run.file}' is the same run as '{other.file}'; leave one out.")
