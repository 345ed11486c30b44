"""A run of the whole graph from start to end."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from graph import Graph

from pga_me_ros.core.operators import Operator
from pga_me_ros.core.storage.repertoire import Repertoire


def test_a_run_ends_with_a_repertoire_of_its_budget(graph: Graph, tmp_path: Path) -> None:
    run = graph.run(tmp_path / "run")
    assert run.wait() == 0, run.output
    with Repertoire.open(tmp_path / "run" / "repertoire.db", read_only=True) as repertoire:
        metrics = repertoire.metrics()
    assert [m.evaluations for m in metrics] == [10, 20, 30]
    made = dict(zip(Operator, metrics[-1].offspring, strict=True))
    assert +Counter(made) == {Operator.GA: 5, Operator.PG: 4, Operator.GREEDY: 1}


def test_a_renamed_service_is_renamed_for_all_nodes(graph: Graph, tmp_path: Path) -> None:
    run = graph.run(tmp_path / "run", "-r", "archive/add:=archive/insert")
    assert run.wait() == 0, run.output
