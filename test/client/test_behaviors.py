"""Controllers read from messages give the same actions as in the evaluation; malformed ones are refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from pga_me_msgs.msg import Controller as ControllerMsg

from pga_me_ros.client import Controller
from pga_me_ros.core.networks.controller import MlpController as Network
from pga_me_ros.core.networks.mlp import MlpShape, random_parameters
from pga_me_ros.errors import NetworkError
from pga_me_ros.ros.convert import controller_to_msg, flat
from pga_me_ros.tasks.registry import task_spec

SPEC = task_spec("qd_walker")
SHAPE = MlpShape((22, 128, 128, 6))
PARAMETERS = random_parameters(SHAPE, np.random.default_rng(1))


@pytest.fixture
def msg() -> ControllerMsg:
    return controller_to_msg(PARAMETERS, SHAPE, SPEC)


def test_actions_equal_the_evaluators_bit_for_bit(msg: ControllerMsg) -> None:
    robots, evaluators = Controller.from_msg(msg), Network(SHAPE, PARAMETERS)
    observations = np.random.default_rng(2).normal(size=(200, 22)).astype(np.float32)
    for observation in observations:
        assert robots(observation).tobytes() == evaluators(observation).tobytes()


def test_the_message_is_enough_to_compute_an_action(msg: ControllerMsg) -> None:
    """Follow the description in Controller.msg in plain float64."""
    observation = np.random.default_rng(3).normal(size=22)
    x, at = observation, 0
    sizes = list(msg.layer_sizes)
    for n_in, n_out, name in zip(sizes[:-1], sizes[1:], msg.activations, strict=True):
        weight = np.reshape(msg.parameters[at : at + n_in * n_out], (n_out, n_in))
        bias = np.array(msg.parameters[at + n_in * n_out : at + (n_in + 1) * n_out])
        x = {"relu": lambda v: np.maximum(v, 0.0), "tanh": np.tanh}[name](weight @ x + bias)
        at += (n_in + 1) * n_out
    assert at == len(msg.parameters)
    np.testing.assert_allclose(Controller.from_msg(msg)(observation), x, atol=1e-5)


def test_names_units_limits_and_period_are_passed_on(msg: ControllerMsg) -> None:
    controller = Controller.from_msg(msg)
    assert controller.observation_names == SPEC.observation_names
    assert controller.action_units == SPEC.action_units
    assert tuple(controller.action_high) == SPEC.action_high
    assert (controller.task, controller.control_period) == ("qd_walker", SPEC.control_period)


def too_few_parameters(msg: ControllerMsg) -> None:
    msg.parameters = flat(PARAMETERS[:-1], "f")


def no_number(msg: ControllerMsg) -> None:
    msg.parameters[7] = float("nan")


def other_activation(msg: ControllerMsg) -> None:
    msg.activations = ["relu", "relu", "linear"]


def activation_missing(msg: ControllerMsg) -> None:
    msg.activations = ["relu", "tanh"]


def no_layers(msg: ControllerMsg) -> None:
    msg.layer_sizes = flat([], "q")


def layer_without_neurons(msg: ControllerMsg) -> None:
    msg.layer_sizes = flat([22, 0, 6], "q")


def name_missing(msg: ControllerMsg) -> None:
    msg.observation_names = list(SPEC.observation_names[1:])


def limit_missing(msg: ControllerMsg) -> None:
    msg.action_high = flat([1.0], "d")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (too_few_parameters, r"shape \(20229,\), but layers \[22, 128, 128, 6\] take \(20230,\)"),
        (no_number, "Parameter 7 is nan"),
        (other_activation, "activations are .*'linear'.* take .*'tanh'"),
        (activation_missing, r"activations are \['relu', 'tanh'\]"),
        (no_layers, r"Layer sizes \[\] make no network"),
        (layer_without_neurons, r"Layer sizes \[22, 0, 6\] make no network"),
        (name_missing, "21 observation_names, but its layers .* need 22"),
        (limit_missing, "1 action_high, but its layers .* need 6"),
    ],
)
def test_a_malformed_controller_is_refused_with_a_reason(
    msg: ControllerMsg, spoil: Callable[[ControllerMsg], None], words: str
) -> None:
    spoil(msg)
    with pytest.raises(NetworkError, match=words):
        Controller.from_msg(msg)


@pytest.mark.parametrize("shape", [(), (1,), (21,), (1, 22)])
def test_an_observation_of_another_shape_is_refused(
    msg: ControllerMsg, shape: tuple[int, ...]
) -> None:
    with pytest.raises(NetworkError, match=r"this controller takes \(22,\)"):
        Controller.from_msg(msg)(np.zeros(shape))


def test_a_broken_sensor_gives_no_action(msg: ControllerMsg) -> None:
    observation = np.zeros(22)
    observation[4] = np.nan
    with pytest.raises(NetworkError, match=rf"Entry 4 .*{SPEC.observation_names[4]}.* is nan"):
        Controller.from_msg(msg)(observation)


def test_changing_the_message_does_not_change_the_controller(msg: ControllerMsg) -> None:
    controller = Controller.from_msg(msg)
    with pytest.raises(ValueError, match="read-only"):
        controller.parameters[0] = 1.0
