"""What a fuzzer sends to the graph: hypothesis strategies for requests and messages, from valid to malformed.

A case that could change the run never has the run's id, the next generation and valid content all at once: such a
message would be the run's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fuzz_targets import FOREIGN, Target, World
from fuzz_values import (
    FLOATS,
    HUGE,
    HUGE_ONE_IN,
    INT64,
    STRINGS,
    arrays,
    numbers,
    value_of,
)
from hypothesis import strategies as st
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue

from pga_me_ros.core.settings import RATES
from pga_me_ros.ros import names


@dataclass(frozen=True)
class Case:
    """One request or message.

    Attributes:
        target: Name of the service or topic.
        fields: Values of the message's fields; others keep their defaults.
        refused: Whether an answer must be a refusal.
        relative: Names of fields that are relative to the newest committed generation.
    """

    target: str
    fields: dict[str, Any]
    refused: bool = False
    relative: tuple[str, ...] = ()


@st.composite
def run_cases(draw: st.DrawFn, target: Target, types: Mapping[str, str]) -> Case:
    """Draw a message to a target of the run: a foreign one, a faulty one with the run's id, or a harmless one.

    Args:
        draw: Given by hypothesis.
        target: Its target.
        types: Types of the message's fields.
    """
    fields = dict(target.sound)
    kinds = ["faulty", "faulty"] + ["foreign"] * target.owned + ["sound"] * target.harmless
    kind = draw(st.sampled_from(kinds))
    if kind == "foreign":
        fields |= draw(some_fields(types, most=3))
        fields["run_id"] = draw(st.one_of(st.just(FOREIGN), value_of("string")))
        return Case(target.name, fields, True)
    if kind == "faulty":
        name, value = draw(st.sampled_from(target.faults))
        if draw(st.integers(0, HUGE_ONE_IN)) == HUGE_ONE_IN and arrays(types):
            name, typecode = draw(st.sampled_from(arrays(types)))
            value = numbers(typecode, HUGE)
        fields[name] = value
    return Case(target.name, fields, kind == "faulty", target.generations)


@st.composite
def any_cases(draw: st.DrawFn, target: str, types: Mapping[str, str]) -> Case:
    """Draw a message to a target that accepts anything from anybody."""
    return Case(target, draw(some_fields(types, most=5)))


@st.composite
def some_fields(draw: st.DrawFn, types: Mapping[str, str], most: int) -> dict[str, Any]:
    """Draw values for some of a message's fields."""
    fields = {}
    for name in draw(st.lists(st.sampled_from(sorted(types)), max_size=most)) if types else ():
        value = draw(value_of(types[name]))
        if value is not None:
            fields[name] = value
    return fields


@st.composite
def status_cases(draw: st.DrawFn, world: World, types: Mapping[str, str]) -> Case:
    """Draw a heartbeat that looks as genuine as a stranger who has listened can make it."""
    fields = draw(some_fields(types, most=2))
    likely = {
        "kind": ("evaluator", "archive_manager", "critic_trainer", "variation"),
        "task": (world.settings.task, "qd_ant"),
        "versions": (world.versions, "pybullet 1, numpy 1"),
        "node": (*STRINGS, *world.nodes, "/stray", "stray/", "//", "/a/{b}", "~"),
        "host": (world.host, "elsewhere"),
        "pid": (*world.pids, *INT64),
        "done": INT64,
    }
    for name, values in likely.items():
        fields.setdefault(name, draw(st.sampled_from(values)))
    return Case(names.STATUS, fields)


@st.composite
def parameter_cases(draw: st.DrawFn, service: str, known: Sequence[str]) -> Case:
    """Draw a request to set parameters that must not be set, cannot be set, or do not matter.

    Args:
        draw: Given by hypothesis.
        service: set_parameters or set_parameters_atomically of a node.
        known: Names of the node's parameters.
    """
    listed = []
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from((*known, *STRINGS)))
        value = ParameterValue(type=draw(st.sampled_from((*range(11), 77, 255))))
        rate = name in RATES  # a value within its range would be set
        value.integer_value = draw(st.sampled_from((-1, 2**63 - 1) if rate else INT64))
        value.double_value = draw(st.sampled_from((FLOATS[0], -1e308, 1e30) if rate else FLOATS))
        value.bool_value = draw(st.booleans())
        value.string_value = draw(st.sampled_from(STRINGS))
        value.integer_array_value = draw(st.sampled_from(([], [1], [-1] * 1000)))
        listed.append(Parameter(name=name, value=value))
    sim_time = [p for p in listed if p.name == "use_sim_time"]
    settable = any(p.value.type == ParameterType.PARAMETER_BOOL for p in sim_time)
    return Case(service, {"parameters": listed}, not settable)
