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

PARAMETERS = {"random_init": 10, "evaluations": 30}


def search_digest(controllers: np.ndarray, evaluations: int) -> str:
    values = {**TINY, **PARAMETERS, "evaluations": evaluations}
    settings = Settings.from_mapping({n: v for n, v in values.items() if n not in NOT_SETTINGS})
    task = load_task(settings.task)()
    search = Search(task.spec, settings, controllers)
    while search.generation < settings.generations:
        search.run_generation(task)
    task.close()
    return search.archive.digest()


def test_a_run_from_a_repertoire_is_that_of_search_and_survives_its_source(
    graph: Graph, tmp_path: Path
) -> None:
    source = tmp_path / "source.db"
    archive = store(source)
    controllers = archive.parameters[archive.filled]
    assert 10 < len(controllers) <= 20, "one more generation than random_init alone"
    run = graph.run(tmp_path / "run", **PARAMETERS, start_from=source, evaluators=2)
    assert run.wait() == 0, run.output
    assert run_digest(tmp_path / "run") == search_digest(controllers, 30)

    source.unlink()
    longer = {**PARAMETERS, "evaluations": 40}
    run = graph.run(tmp_path / "run", **longer, start_from=source, evaluators=1)
    assert run.wait() == 0, run.output
    assert run_digest(tmp_path / "run") == search_digest(controllers, 40)
