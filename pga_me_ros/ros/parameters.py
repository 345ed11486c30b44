"""ROS parameters from settings dataclasses: declared with descriptors, and checked with readable messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, fields
from typing import Any, cast

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from pga_me_ros.core.settings import Settings
from pga_me_ros.core.settings.field import INT64_MAX, checked_value, named_paths
from pga_me_ros.core.storage.files import require_reachable
from pga_me_ros.errors import PgaError, SettingsError, nearest_name

ROS_OWN = ("use_sim_time", "start_type_description_service")
"""Parameters that rclpy declares by itself."""


def declare(
    node: Node, *kinds: type, shared: tuple[type, ...] = (), fixed: bool = False
) -> dict[str, Any]:
    """Declare the fields of settings dataclasses as parameters and return their values.

    The node must have been made with ``automatically_declare_parameters_from_overrides=True``, so that every value
    given on the command line or in a YAML file is visible, misspelled ones included.

    Args:
        node: Node to declare on.
        kinds: Dataclasses whose fields were made by `pga_me_ros.core.settings.field.setting`.
        shared: Dataclasses with parameters of other nodes: ignored, so that one YAML file serves all nodes.
        fixed: Whether rates are read-only, too, as in nodes that get them with each request.

    Returns:
        Checked values by name.

    Raises:
        SettingsError: A given name is unknown, a value has the wrong type or is out of range, or a path cannot be
            reached.
    """
    known, values = _checked(node, kinds, shared)
    _declare(node, known, values, fixed=fixed)
    return values


def _checked(
    node: Node, kinds: tuple[type, ...], shared: tuple[type, ...] = ()
) -> tuple[dict[str, Field[Any]], dict[str, Any]]:
    """Undeclare the parameters that a node was given; return fields and checked values by name, see `declare`."""
    # rclpy annotates this with the types of values, but returns parameters.
    parameters = cast(Mapping[str, Parameter], node.get_parameters_by_prefix(""))
    given = {n: p.value for n, p in parameters.items() if not is_ros_own(n)}
    known = {f.name: f for kind in kinds for f in fields(kind)}
    others = {f.name for kind in shared for f in fields(kind)}
    for name in given:
        if name not in known and name not in others:
            raise SettingsError(
                f"Unknown parameter '{name}'{nearest_name(name, [*known, *others])}; --help lists "
                f"those of '{node.get_name()}', docs/parameters.md all."
            )
        node.undeclare_parameter(name)
    values = {name: checked_value(f, given.get(name, f.default)) for name, f in known.items()}
    for name, f in known.items():
        for path in named_paths(f, values[name]):
            require_reachable(name, path)
    return known, values


def _declare(
    node: Node, known: Mapping[str, Field[Any]], values: Mapping[str, Any], *, fixed: bool
) -> None:
    for name, f in known.items():
        value = list(values[name]) if isinstance(values[name], tuple) else values[name]
        described = descriptor(f)
        described.read_only |= fixed
        node.declare_parameter(name, value, described, ignore_override=True)
    node.add_pre_set_parameters_callback(lambda given: [_in_own_type(node, p) for p in given])


def _in_own_type(node: Node, given: Parameter) -> Parameter:
    """Return a parameter that is about to be set in the type that it was declared with, where no digit is lost.

    ``ros2 param set NODE iso_sigma 1`` sends an integer, which rclpy would refuse.
    """
    kind = node.get_parameter(given.name).type_ if node.has_parameter(given.name) else given.type_
    if kind is Parameter.Type.DOUBLE and given.type_ is Parameter.Type.INTEGER:
        return Parameter(given.name, kind, float(given.value))
    may_be_whole = kind is Parameter.Type.INTEGER and given.type_ is Parameter.Type.DOUBLE
    if may_be_whole and given.value.is_integer() and abs(given.value) < INT64_MAX:
        return Parameter(given.name, kind, int(given.value))
    return given


def declare_run(
    node: Node, options: type, *, fixed: bool = False
) -> tuple[Settings, dict[str, Any]]:
    """Declare the settings of a run and a node's own options; `fixed` as in `declare`.

    Parameters show the values in force: the algorithm's own value if the default stands for it.

    Returns:
        The settings, and the options by name.

    Raises:
        SettingsError: As for `declare`; also if the settings contradict each other.
    """
    known, values = _checked(node, (Settings, options))
    names = {f.name for f in fields(Settings)}
    settings = Settings.from_mapping({n: v for n, v in values.items() if n in names})
    _declare(node, known, values | {n: getattr(settings, n) for n in names}, fixed=fixed)
    return settings, {n: v for n, v in values.items() if n not in names}


def descriptor(f: Any) -> ParameterDescriptor:
    """Return the ROS descriptor of a settings field: description, unit, symbol, range, and whether it is read-only."""
    meta = f.metadata
    text = meta["description"]
    if meta["symbol"]:
        text += f" Symbol: {meta['symbol']}."
    if meta["unit"]:
        text += f" Unit: {meta['unit']}."
    out = ParameterDescriptor(description=text, read_only=not meta["rate"])
    if meta["choices"]:
        out.additional_constraints = "one of: " + ", ".join(meta["choices"])
    if meta["low"] is not None and isinstance(f.default, float):
        out.floating_point_range = [
            FloatingPointRange(from_value=float(meta["low"]), to_value=float(meta["high"]))
        ]
    elif meta["low"] is not None:
        out.integer_range = [IntegerRange(from_value=int(meta["low"]), to_value=int(meta["high"]))]
    return out


def on_change(
    node: Node, check: Callable[[dict[str, Any]], object], apply: Callable[[dict[str, Any]], None]
) -> None:
    """Check changes of rates before they are accepted, and apply them afterwards.

    Args:
        node: Node whose parameters change.
        check: Called with the changed names and values; raises `PgaError` to refuse them.
        apply: Called with accepted changes.
    """

    def checked(parameters: Iterable[Parameter]) -> SetParametersResult:
        try:
            check({p.name: p.value for p in parameters if not is_ros_own(p.name)})
        except PgaError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def applied(parameters: Iterable[Parameter]) -> None:
        apply({p.name: p.value for p in parameters if not is_ros_own(p.name)})

    node.add_on_set_parameters_callback(checked)
    node.add_post_set_parameters_callback(applied)


def is_ros_own(name: str) -> bool:
    """Whether a parameter is one that every node has, which ROS 2 itself reads."""
    return name in ROS_OWN or name.startswith("qos_overrides.")
