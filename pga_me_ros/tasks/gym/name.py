"""Names of Gymnasium tasks: ``gymnasium:ID``, or ``gymnasium:ID?option=value&option=value``.

Own options are the fields of `Options`. Every other one is an argument of the environment, as in
``gymnasium:Ant-v5?include_cfrc_ext_in_observation=false&descriptor=final_position``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qsl

import yaml

from pga_me_ros.errors import TaskError

PREFIX = "gymnasium:"


@dataclass(frozen=True)
class Options:
    """What a name says about the task.

    Attributes:
        env_id: Registered id of the environment, for example ``Walker2d-v5``.
        kwargs: Arguments of the environment.
        wrappers: Wrappers to apply, innermost first, each as ``module:Class``.
        descriptor: ``feet``, ``final_position`` or ``module:name`` (`pga_me_ros.tasks.gym.descriptors`); empty for
            ``feet``.
        low: Lower bound of each descriptor dimension; empty for the descriptor's own.
        high: Upper bound of each.
        max_steps: Time limit, steps; 0 for the environment's own.
        cells: Default number of cells of a CVT archive.
    """

    env_id: str
    kwargs: Mapping[str, Any] = field(default_factory=dict)
    wrappers: tuple[str, ...] = ()
    descriptor: str = ""
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()
    max_steps: int = 0
    cells: int = 1024


def read_name(name: str) -> Options:
    """Return what a task's name says.

    Raises:
        TaskError: It is not of that form, names an option twice, or a value makes no sense.
    """
    env_id, _, query = name.removeprefix(PREFIX).partition("?")
    if not env_id:
        raise TaskError(
            f"task '{name}' names no environment; expected for example '{PREFIX}Walker2d-v5'"
        )
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True) if query else []
    except ValueError:
        raise TaskError(
            f"task '{name}': what follows the '?' is not option=value&option=value"
        ) from None
    own: dict[str, Any] = {"wrappers": tuple(text for key, text in pairs if key == "wrapper")}
    kwargs: dict[str, Any] = {}
    for key, text in pairs:
        if key == "wrapper":
            continue
        if key in own or key in kwargs:
            raise TaskError(f"task '{name}' gives the option '{key}' twice; leave one out")
        if key in _READ:
            own[key] = _READ[key](name, key, text)
        else:
            kwargs[key] = yaml.safe_load(text)
    return Options(env_id, kwargs, **own)


def _count(name: str, key: str, text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 10_000_000:
        raise TaskError(
            f"task '{name}': {key} is '{text}'; expected a whole number from 1 to 10,000,000"
        )
    return int(text)


def _numbers(name: str, key: str, text: str) -> tuple[float, ...]:
    try:
        return tuple(float(number) for number in text.split(","))
    except ValueError:
        raise TaskError(
            f"task '{name}': {key} is '{text}'; expected numbers separated by commas, one per descriptor dimension"
        ) from None


def _text(_name: str, _key: str, text: str) -> str:
    return text


_READ = {
    "descriptor": _text,
    "low": _numbers,
    "high": _numbers,
    "max_steps": _count,
    "cells": _count,
}
"""How to read each own option but ``wrapper``, which may come several times."""
