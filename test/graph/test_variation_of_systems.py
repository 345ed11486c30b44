"""A variation node makes only the offspring of its run's algorithm, from that algorithm's snapshots."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from graph import Graph, Probe, wait_until
from pga_me_msgs.msg import CriticSnapshot, Elites, NodeStatus
from pga_me_msgs.srv import Propose
from reference import run_settings

from pga_me_ros.core.networks.conditioned import ConditionedDimensions, conditions, folded
from pga_me_ros.core.networks.mlp import random_critic, random_parameters
from pga_me_ros.core.networks.shapes import controller_shape, critic_shape
from pga_me_ros.core.settings import Settings
from pga_me_ros.core.snapshot import Snapshot
from pga_me_ros.core.variation.policy_gradient import pg_variation
from pga_me_ros.ros import names, qos
from pga_me_ros.ros.convert import flat, rates_to_msg, snapshot_to_msg
from pga_me_ros.tasks.registry import task_spec

SPEC = task_spec("qd_hopper")
PGA = run_settings(task=SPEC.name)
QD_RL = PGA.replace(algorithm="qd_rl", n_evo=Settings.n_evo)
DCRL = PGA.replace(algorithm="dcrl_map_elites", pg_learning_rate=PGA.pg_learning_rate)
SHAPE, CRITIC = controller_shape(SPEC, PGA), critic_shape(SPEC, PGA)
RNG = np.random.default_rng(0)
ONE_CRITIC = Snapshot(
    generation=1,
    version=10,
    networks={
        "critic": (CRITIC, random_critic(CRITIC, RNG)),
        "greedy": (SHAPE, random_parameters(SHAPE, RNG)),
    },
    states=RNG.standard_normal((1, 2, 32, SPEC.observation_dim), np.float32),
    transitions=100,
    critic_loss=1.0,
    mean_q=1.0,
)
TWO_CRITICS = dataclasses.replace(
    ONE_CRITIC,
    networks={**ONE_CRITIC.networks, "diversity_critic": (CRITIC, random_critic(CRITIC, RNG))},
)
SEEN = ConditionedDimensions.of(SPEC)
CONDITIONED = dataclasses.replace(
    ONE_CRITIC,
    networks={
        "critic": (critic_shape(SEEN, PGA), random_critic(critic_shape(SEEN, PGA), RNG)),
        "actor": (controller_shape(SEEN, PGA), random_parameters(controller_shape(SEEN, PGA), RNG)),
    },
)
PARENT = random_parameters(SHAPE, RNG)
PARENT_ID = 7
DESCRIPTOR = [0.3]


class Variation:
    """A variation node, and a node that calls it."""

    def __init__(self, graph: Graph, settings: Settings) -> None:
        self._settings = settings
        given = {name: value for name, value in settings.to_dict().items() if value != ""}
        self.started = graph.start("variation", {**given, "run_id": "r"})
        self.probe = Probe(graph.domain)
        node = self.probe.node
        self._snapshots = node.create_publisher(CriticSnapshot, names.SNAPSHOT, qos.LATCHED)
        self._elites = node.create_publisher(Elites, names.ELITES, qos.ELITES)

    def hear(self, snapshot: Snapshot) -> None:
        """Publish a snapshot when the node has subscribed."""
        wait_until(lambda: self._snapshots.get_subscription_count() > 0, "a subscription")
        self._snapshots.publish(snapshot_to_msg(snapshot, "r"))

    def hear_parent(self, **changes: Any) -> None:
        """Publish the parent as an elite when the node has subscribed."""
        wait_until(lambda: self._elites.get_subscription_count() > 0, "a subscription")
        fields = {
            "run_id": "r",
            "cells": flat([3], "q"),
            "evaluations": flat([PARENT_ID], "q"),
            "parameters": flat(PARENT, "f"),
            "descriptors": flat(DESCRIPTOR, "d"),
        }
        self._elites.publish(Elites(**{**fields, **changes}))

    def propose(self, operator: int) -> Any:
        """Request one offspring of generation 1."""
        return self.probe.call(
            Propose,
            names.PROPOSE,
            run_id="r",
            generation=1,
            operator_id=operator,
            first=1,
            count=1,
            parents=flat([PARENT_ID], "q"),
            rates=rates_to_msg(self._settings),
        )

    def close(self) -> None:
        """Close the probe; the graph stops the node."""
        self.probe.close()


@pytest.fixture
def variation(graph: Graph, request: pytest.FixtureRequest) -> Iterator[Variation]:
    started = Variation(graph, request.param)
    yield started
    started.close()


def climbed(critic: np.ndarray) -> np.ndarray:
    rate = PGA.pg_learning_rate
    return pg_variation(PARENT[None], critic, ONE_CRITIC.states[0], rate, SHAPE, CRITIC)


@pytest.mark.parametrize("variation", [QD_RL], indirect=True)
def test_qd_rl_climbs_the_critic_of_quality_or_of_diversity(variation: Variation) -> None:
    variation.hear(ONE_CRITIC)
    variation.started.wait_for_output("it has no network 'diversity_critic'; qd_rl needs one")
    assert variation.propose(Propose.Request.DIVERSITY).again
    variation.hear(TWO_CRITICS)
    variation.hear_parent()
    answer = None

    def made() -> bool:
        nonlocal answer
        answer = variation.propose(Propose.Request.DIVERSITY)
        return bool(answer.accepted)

    wait_until(made, "offspring of diversity")
    diversity, quality = answer, variation.propose(Propose.Request.QUALITY)
    for got, critic in (
        (diversity, TWO_CRITICS.parameters("diversity_critic")),
        (quality, TWO_CRITICS.parameters("critic")),
    ):
        np.testing.assert_array_equal(got.parameters, climbed(critic)[0])
    refused = variation.propose(Propose.Request.PG)
    assert "Operator 2 is unknown; expected one of 0, 6, 7" in refused.message


@pytest.mark.parametrize("variation", [DCRL], indirect=True)
def test_dcrl_map_elites_says_what_its_offspring_are_meant_to_achieve(variation: Variation) -> None:
    variation.hear(ONE_CRITIC)
    variation.started.wait_for_output("it has no network 'actor'; dcrl_map_elites needs one")
    variation.hear(CONDITIONED)
    variation.hear_parent()
    answer = None

    def made() -> bool:
        nonlocal answer
        answer = variation.propose(Propose.Request.ACTOR_INJECTION)
        return bool(answer.accepted)

    wait_until(made, "an injected actor")
    assert answer is not None
    wanted = conditions(np.array([DESCRIPTOR]), SPEC)
    for got, expected in (
        (answer, folded(*CONDITIONED.network("actor"), SPEC.observation_dim, wanted)[1][0]),
        (
            variation.propose(Propose.Request.PG),
            climbed(folded(*CONDITIONED.network("critic"), SPEC.observation_dim, wanted)[1])[0],
        ),
    ):
        np.testing.assert_array_equal(got.parameters, expected)
        assert list(got.intended_descriptors) == DESCRIPTOR
    again = variation.propose(Propose.Request.PG)  # as when the answer was lost
    assert list(again.intended_descriptors) == DESCRIPTOR
    refused = variation.propose(Propose.Request.DIVERSITY)
    assert "Operator 7 is unknown; expected one of 0, 1, 2, 9" in refused.message


@pytest.mark.parametrize("variation", [PGA], indirect=True)
def test_pga_map_elites_has_no_critic_of_diversity(variation: Variation) -> None:
    variation.hear(TWO_CRITICS)
    words = "it has a network 'diversity_critic'; pga_map_elites has none"
    variation.started.wait_for_output(words)
    assert variation.propose(Propose.Request.PG).again
    for operator in (
        Propose.Request.QUALITY,
        Propose.Request.DIVERSITY,
        Propose.Request.ES_SAMPLE,
    ):
        refused = variation.propose(operator)
        assert not refused.accepted
        assert f"Operator {operator} is unknown; expected one of 0, 1, 2" in refused.message


@pytest.mark.parametrize("variation", [PGA], indirect=True)
def test_a_snapshot_that_has_yet_to_arrive_is_not_a_refusal(variation: Variation) -> None:
    signs = variation.probe.listen(NodeStatus, names.STATUS, qos.STATUS)
    early = variation.propose(Propose.Request.PG)
    assert (early.accepted, early.again) == (False, True)
    assert "need its critic snapshot; here are those of []" in early.message
    unknown = variation.propose(Propose.Request.DIVERSITY)
    assert (unknown.accepted, unknown.again) == (False, False)
    wait_until(lambda: any(sign.refused for sign in list(signs)), "a refusal")
    assert (signs[-1].refused, "Operator 7 is unknown" in signs[-1].last_error) == (1, True)


@pytest.mark.parametrize("variation", [PGA], indirect=True)
def test_a_parent_that_has_yet_to_arrive_is_not_a_refusal(variation: Variation) -> None:
    variation.hear_parent(run_id="stray")
    variation.started.wait_for_output("dropped elites: This request is for run 'stray'")
    variation.hear_parent(cells=flat([10**6], "q"))
    variation.started.wait_for_output("dropped elites: Field 'cells' holds 1000000")
    variation.hear(ONE_CRITIC)
    answers = [variation.propose(Propose.Request.PG)]

    def lacks_the_parent() -> bool:  # after the snapshot has arrived
        answers.append(variation.propose(Propose.Request.PG))
        return bool(answers[-1].lacking)

    wait_until(lacks_the_parent, "the snapshot")
    assert not any(answer.accepted for answer in answers)
    assert (answers[-1].again, list(answers[-1].lacking)) == (True, [PARENT_ID])
    assert "have archive/sample_parents publish them" in answers[-1].message
    variation.hear_parent()

    def made() -> bool:
        answers.append(variation.propose(Propose.Request.PG))
        return bool(answers[-1].accepted)

    wait_until(made, "offspring")
    np.testing.assert_array_equal(
        answers[-1].parameters, climbed(ONE_CRITIC.parameters("critic"))[0]
    )
