"""One repertoire, bit for bit, however the work was distributed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from graph import Graph
from reference import ES, run_digest, search_digest

SEED = 1
"""With this seed, robots fall early in every variant; with seed 0, MAP-Elites-ES simulates 30 times as long."""

WALKER: dict[str, Any] = {"task": "qd_walker", "seed": SEED, "evaluations": 50}
ANT: dict[str, Any] = {
    "task": "qd_ant",
    "seed": 2,
    "evaluations": 15,
    "batch_size": 5,
    "random_init": 5,
    "n_evo": 2,
}

DCRL: dict[str, Any] = {"algorithm": "dcrl_map_elites", "seed": SEED, "evaluations": 40}

VARIANTS: dict[str, dict[str, Any]] = {
    "alternating": {"schedule": "alternating", "pg_batches": "own", "n_evo": 0, "archive": "grid"},
    "as coded": {
        "critic_start": "last_init_batch",
        "greedy_init": "best",
        "greedy_takes": "ga",
        "random_init": 20,
        "line_noise": "tensor",
    },
    "MAP-Elites": {"n_evo": 10},
    "TD3": {"algorithm": "td3", "exploration_correlation": 0.9},
    "MAP-Elites-ES": {**ES, "evaluations": 55},
    "QD-RL": {"algorithm": "qd_rl"},
    "evaluated again": {"extract_share": 0.3, "cell_depth": 2},
    "randomized": {
        "randomization": "mass 0.5 2, friction 0.2 1, torque 0.8 1.2, delay 0 2, noise 0 0.1, push 0 300"
    },
    "DCRL-MAP-Elites": {**DCRL, "schedule": "alternating", "injection_share": 0.2},
    "DCRL-MAP-Elites, evaluated again": {**DCRL, "n_evo": 0, "extract_share": 0.5, "cell_depth": 2},
}


@pytest.mark.parametrize(
    ("parameters", "evaluators"),
    [
        pytest.param(WALKER, 1, id="qd_walker-1"),
        pytest.param(WALKER, 3, id="qd_walker-3"),
        pytest.param(ANT, 3, id="qd_ant-3"),
        pytest.param(DCRL, 3, id="dcrl_map_elites-3"),
    ],
)
def test_graph_and_search_give_the_same_repertoire(
    graph: Graph, tmp_path: Path, parameters: dict[str, Any], evaluators: int
) -> None:
    run = graph.run(tmp_path / "run", **parameters, evaluators=evaluators)
    assert run.wait() == 0, run.output
    assert run_digest(tmp_path / "run") == search_digest(**parameters)


PARTNERS = {"alternating": "randomized", "as coded": "evaluated again"}
"""Variants that change different parts of a run, so that one run of the graph can show both."""

IN_GRAPH = {
    name: {**variant, **VARIANTS.get(PARTNERS.get(name, ""), {})}
    for name, variant in VARIANTS.items()
    if name not in PARTNERS.values()
}


@pytest.mark.parametrize("variant", IN_GRAPH.values(), ids=IN_GRAPH.keys())
def test_graph_and_search_agree_on_every_variant(
    graph: Graph, tmp_path: Path, variant: dict[str, Any]
) -> None:
    parameters = {"evaluations": 40, "seed": SEED, **variant}
    run = graph.run(tmp_path / "run", **parameters, evaluators=2)
    assert run.wait() == 0, run.output
    assert run_digest(tmp_path / "run") == search_digest(**parameters)


@pytest.mark.parametrize("change", [{"seed": 2}, *VARIANTS.values()], ids=str)
def test_another_seed_or_variant_gives_another_repertoire(change: dict[str, Any]) -> None:
    start = change.get("random_init", 10)
    parameters = {"evaluations": 40, "seed": SEED, "random_init": start}
    assert search_digest(**parameters) != search_digest(**{**parameters, **change})
