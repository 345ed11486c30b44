"""A graph that starts from an existing repertoire ends with the repertoire of `core.search`, resumed or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from graph import TINY, Graph
from reference import NOT_SETTINGS, run_digest
from stored import store

from pga_me_ros.core.search import Search
from pga_me_ros.core.settings import Settings
from pga_me_ros.tasks.registry import load_task

PARAMETERS = {"random_init": 10, "evaluations": 20}


def search_digests(controllers: np.ndarray, *generations: int) -> list[str]:
    """Return the digests of a search from the given controllers after so many generations."""
    values = {**TINY, **PARAMETERS}
    settings = Settings.from_mapping({n: v for n, v in values.items() if n not in NOT_SETTINGS})
    task = load_task(settings.task)()
    search = Search(task.spec, settings, controllers)
    digests = []
    for generation in generations:
        while search.generation < generation:
            search.run_generation(task)
        digests.append(search.archive.digest())
    task.close()
    return digests


def test_a_run_from_a_repertoire_is_that_of_search_and_survives_its_source(
    graph: Graph, tmp_path: Path
) -> None:
    source = tmp_path / "source.db"
    archive = store(source)
    controllers = archive.parameters[archive.filled]
    assert 10 < len(controllers) <= 20, "one more generation than random_init alone"
    expected = search_digests(controllers, 2, 3)
    run = graph.run(tmp_path / "run", **PARAMETERS, start_from=source)
    assert run.wait() == 0, run.output
    assert run_digest(tmp_path / "run") == expected[0]

    source.unlink()
    longer = {**PARAMETERS, "evaluations": 30}
    run = graph.run(tmp_path / "run", **longer, start_from=source)
    assert run.wait() == 0, run.output
    assert run_digest(tmp_path / "run") == expected[1]
