"""An actor read from a message acts as the trained one; what is malformed is refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from pga_me_msgs.srv import GetActor

from pga_me_ros.client import Actor, ActorNotFoundError
from pga_me_ros.client.answers import read_actor
from pga_me_ros.core.networks.conditioned import ConditionedActor
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.errors import NetworkError
from pga_me_ros.serving.actor_service import UNLIMITED, actor_to_msg
from pga_me_ros.tasks.registry import task_spec

SPEC = dataclasses.replace(
    task_spec("qd_walker"), descriptor_low=(-3.0, 0.0), descriptor_high=(5.0, 0.25)
)
SHAPE = MlpShape((22 + 2, 128, 128, 6))
TRAINED = ConditionedActor(SPEC, SHAPE, random_parameters(SHAPE, np.random.default_rng(1)))
SEEN = np.random.default_rng(2).normal(size=22).astype(np.float32)


@pytest.fixture
def response() -> GetActor.Response:
    return GetActor.Response(found=True, generation=7, controller=actor_to_msg(TRAINED, SPEC))


def test_it_does_what_the_trained_one_does(response: GetActor.Response) -> None:
    actor = read_actor(response)
    rng = np.random.default_rng(3)
    for wanted in rng.uniform((-5.0, -0.1), (7.0, 0.4), (200, 2)):  # beyond the bounds, too
        seen = rng.normal(size=22).astype(np.float32)
        np.testing.assert_allclose(actor(seen, wanted), TRAINED(seen, wanted), rtol=0, atol=5e-6)


def test_it_tells_what_it_takes(response: GetActor.Response) -> None:
    actor = read_actor(response)
    assert (actor.generation, actor.task) == (7, SPEC.name)
    assert actor.control_period == SPEC.control_period
    assert actor.observation_names == SPEC.observation_names
    assert actor.descriptor_names == SPEC.descriptor_names
    assert tuple(actor.descriptor_low) == SPEC.descriptor_low
    assert tuple(actor.descriptor_high) == SPEC.descriptor_high
    whole = actor.controller
    assert whole.observation_names[22:] == tuple(f"wanted/{n}" for n in SPEC.descriptor_names)
    assert tuple(whole.observation_low[:22]) == SPEC.observation_low
    np.testing.assert_array_equal(whole(np.append(SEEN, [1.0, 0.2])), actor(SEEN, [1.0, 0.2]))


def test_an_observation_without_limits_has_none_in_the_message() -> None:
    spec = dataclasses.replace(SPEC, observation_low=(), observation_high=())
    msg = actor_to_msg(TRAINED, spec)
    assert list(msg.observation_low) == [-UNLIMITED] * 22 + [-3.0, 0.0]
    assert list(msg.observation_high) == [UNLIMITED] * 22 + [5.0, 0.25]


@pytest.mark.parametrize(
    ("seen", "wanted", "complaint"),
    [
        (SEEN, [0.5], "The descriptor is .0.5.; expected 2 finite numbers: "),
        (SEEN, 0.5, "expected 2 finite numbers"),
        (SEEN, [0.5, np.nan], "expected 2 finite numbers"),
        (SEEN[:-1], [0.5, 0.5], r"The observation has the shape \(21,\); this actor takes \(22,\)"),
        (np.append(SEEN, 0.5), [0.5, 0.5], r"shape \(23,\)"),
        (np.where(np.arange(22) == 3, np.nan, SEEN), [0.5, 0.5], "Entry 3 of the observation"),
    ],
)
def test_nothing_bad_reaches_an_actuator(
    response: GetActor.Response, seen: np.ndarray, wanted: object, complaint: str
) -> None:
    with pytest.raises(NetworkError, match=complaint):
        read_actor(response)(seen, wanted)


def without_limits(response: GetActor.Response) -> None:
    response.controller.observation_low = []
    response.controller.observation_high = []


def without_descriptor(response: GetActor.Response) -> None:
    response.controller.descriptor_names = []


def of_too_many(response: GetActor.Response) -> None:
    response.controller.descriptor_names = [str(k) for k in range(24)]


@pytest.mark.parametrize("spoil", [without_limits, without_descriptor, of_too_many])
def test_a_malformed_message_is_refused(
    response: GetActor.Response, spoil: Callable[[GetActor.Response], None]
) -> None:
    spoil(response)
    with pytest.raises(NetworkError, match="The message is malformed"):
        Actor.from_response(response)


def test_a_repertoire_without_one_says_why() -> None:
    with pytest.raises(ActorNotFoundError, match="learns none"):
        read_actor(GetActor.Response(message="It learns none."))
