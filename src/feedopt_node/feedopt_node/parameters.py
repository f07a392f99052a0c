"""Node parameters: one frozen dataclass a node, filled from ROS or from the same YAML file without ROS.

A field is declared with :func:`parameter`; a field without a default must be given. Inheritance composes dataclasses.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import yaml

from feedopt_core.errors import ConfigError

if TYPE_CHECKING:
    from rclpy.node import Node

P = TypeVar("P")

_ROS_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides.")


def parameter(
    doc: str,
    *,
    default: Any = MISSING,
    unit: str = "",
    range: tuple[float | None, float | None] = (None, None),  # noqa: A002 (the name of the metadata entry)
    choices: tuple[str, ...] = (),
) -> Any:
    """Field of a parameter dataclass.

    Args:
        doc: what it does, one sentence.
        default: its default; without one it must be given.
        unit: its unit, empty for counts and names.
        range: smallest and largest value allowed, None where open.
        choices: the values allowed; empty: any.
    """
    return field(default=default, metadata={"doc": doc, "unit": unit, "range": range, "choices": choices})


@dataclass(frozen=True)
class GraphParameters:
    """Parameters every node of the graph has."""

    present_nodes: tuple[str, ...] = parameter(
        "Nodes of the graph that were started; readiness waits for these alone. Empty: all of them.", default=()
    )


@dataclass(frozen=True, kw_only=True)
class MachineNodeParameters(GraphParameters):
    """Parameters of the nodes that take a machine."""

    machine: str = parameter("Machine file, or its name in config/machines.")


def parameters_from_mapping(cls: type[P], values: Mapping[str, Any], source: str) -> P:
    """Fill and check a parameter dataclass.

    Raises:
        ConfigError: an unknown, missing or impossible value; names the source and the key.
    """
    types = typing.get_type_hints(cls)
    known = {entry.name: entry for entry in fields(cls)}  # type: ignore[arg-type]
    for key in values:
        if key not in known:
            raise ConfigError(f"{source}: unknown parameter {key}; known are {', '.join(known)}")
    checked = {}
    for key, entry in known.items():
        if key in values:
            checked[key] = _checked(values[key], types[key], entry.metadata, f"{source}: {key}")
        elif entry.default is MISSING:
            doc = entry.metadata.get("doc", "")
            raise ConfigError(f"{source}: parameter {key} is missing and has no default: {doc}")
    try:
        return cls(**checked)
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from error


def load_parameters(cls: type[P], path: Path, node: str, *, beside: tuple[str, ...] = ()) -> P:
    """Fill a parameter dataclass from a ROS parameter file: section ``/**`` first, then the node's own.

    Args:
        cls: the dataclass.
        path: the file.
        node: name of the node.
        beside: parameters of the node that stand in the file and not in this dataclass.

    Raises:
        ConfigError: as :func:`parameters_from_mapping`, or the file cannot be read.
    """
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from error
    values: dict[str, Any] = {}
    for section in ("/**", node):
        entry = document.get(section, {}) if isinstance(document, dict) else None
        if not isinstance(entry, dict) or not isinstance(entry.get("ros__parameters", {}), dict):
            raise ConfigError(f"{path}: must be sections of the form '{section}: ros__parameters: name: value'")
        values.update(entry.get("ros__parameters", {}))
    return parameters_from_mapping(cls, {key: values[key] for key in values if key not in beside}, str(path))


def declare_parameters(node: Node, cls: type[P]) -> P:
    """Fill a parameter dataclass from the parameters a node was started with, and declare each of them read-only.

    The node must have been made with ``automatically_declare_parameters_from_overrides=True``.

    Raises:
        ConfigError: as :func:`parameters_from_mapping`.
    """
    # Imported here so that parameter files can be read where ROS is not installed.
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    given = {
        name: tuple(value) if isinstance(value, (list, tuple)) else value
        for name, value in ((name, entry.value) for name, entry in node.get_parameters_by_prefix("").items())
        if not name.startswith(_ROS_OWN)
    }
    parameters = parameters_from_mapping(cls, given, f"parameters of node {node.get_name()}")
    for entry in fields(cls):  # type: ignore[arg-type]
        if node.has_parameter(entry.name):
            # A whole number given for a float was accepted: declare it anew under its right type.
            node.undeclare_parameter(entry.name)
        unit, bounds = entry.metadata.get("unit", ""), entry.metadata.get("range", (None, None))
        value = getattr(parameters, entry.name)
        descriptor = ParameterDescriptor(
            description=entry.metadata.get("doc", "") + (f" [{unit}]" if unit else ""), read_only=True
        )
        if isinstance(value, float) and bounds != (None, None):
            low, high = (-math.inf if bounds[0] is None else bounds[0]), (math.inf if bounds[1] is None else bounds[1])
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        elif isinstance(value, int) and not isinstance(value, bool) and bounds != (None, None):
            low, high = (-(2**63) if bounds[0] is None else bounds[0]), (2**63 - 1 if bounds[1] is None else bounds[1])
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
        _declare(node, entry.name, value, descriptor)
    return parameters


def _declare(node: Node, name: str, value: Any, descriptor: Any) -> None:
    from rclpy.parameter import Parameter

    if value == ():
        # An empty list has no type of its own in ROS: it is declared by type and left without a value.
        value = Parameter.Type.STRING_ARRAY
    elif isinstance(value, tuple):
        value = list(value)
    node.declare_parameter(name, value, descriptor, ignore_override=True)


def _checked(value: Any, kind: Any, metadata: Mapping[str, Any], place: str) -> Any:
    if typing.get_origin(kind) is tuple:
        element = typing.get_args(kind)[0]
        if not isinstance(value, (list, tuple)):
            raise ConfigError(f"{place} is {value!r}, must be a list")
        return tuple(_checked(item, element, metadata, place) for item in value)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if kind in (bool, int, float, str) and (not isinstance(value, kind) or (kind is int and isinstance(value, bool))):
        hint = " (YAML reads 1e-3 as text: write 1.0e-3)" if kind is float and isinstance(value, str) else ""
        raise ConfigError(f"{place} is {value!r}, must be of type {kind.__name__}{hint}")
    unit = f" {metadata['unit']}" if metadata.get("unit") else ""
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{place} is {value!r}, must be finite")
    low, high = metadata.get("range", (None, None))
    if low is not None and value < low:
        raise ConfigError(f"{place} is {value!r}{unit}, must be at least {low}{unit}")
    if high is not None and value > high:
        raise ConfigError(f"{place} is {value!r}{unit}, must be at most {high}{unit}")
    choices = metadata.get("choices", ())
    if choices and value not in choices:
        raise ConfigError(f"{place} is {value!r}, must be one of {', '.join(choices)}")
    return value
