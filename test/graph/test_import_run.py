"""A graph that starts from an existing repertoire ends with the repertoire of `core.search`."""

from __future__ import annotations

from pathlib import Path

from graph import Graph
from reference import run_digest, run_settings
from stored import SPEC, store

from pga_me_ros.core.runs.run_directory import open_run
from pga_me_ros.core.search import Search
from pga_me_ros.tasks.registry import load_task

PARAMETERS = {"random_init": 10, "evaluations": 30}


def test_a_run_from_a_repertoire_equals_that_of_search_even_without_its_source(
    graph: Graph, tmp_path: Path
) -> None:
    source = tmp_path / "source.db"
    archive = store(source)
    controllers = archive.parameters[archive.filled]
    assert 10 < len(controllers) <= 20, "one more generation than random_init"
    settings = run_settings(**PARAMETERS)

    # A run that was stopped before its first generation, and whose source has been deleted.
    from_source = settings.replace(start_from=str(source))
    open_run(tmp_path / "run", SPEC, from_source).lock.release()
    source.unlink()
    run = graph.run(tmp_path / "run", **PARAMETERS, start_from=source, evaluators=2)

    task = load_task(settings.task)()
    search = Search(SPEC, settings, controllers)
    while search.generation < settings.generations:
        search.run_generation(task)
    task.close()
    assert run.wait() == 0, run.output
    assert run_digest(tmp_path / "run") == search.archive.digest()
