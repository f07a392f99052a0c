"""Node parameters: one frozen dataclass per node, filled from ROS or, without ROS, from the same YAML file.

The dataclasses are composed by inheritance. :mod:`feedopt_core.schema` fills and checks them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from feedopt_core.config_files import parse_yaml, read_text, ros_parameters
from feedopt_core.schema import DataclassInstance, Rule, build, parameter, rule_of

if TYPE_CHECKING:
    from rclpy.node import Node

P = TypeVar("P", bound=DataclassInstance)

_ROS_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides.")


@dataclass(frozen=True)
class GraphParameters:
    """Parameters of every node of the graph."""

    present_nodes: tuple[str, ...] = parameter(
        "Nodes of the graph that were started; a node waits only for these. Empty: all nodes.", default=()
    )


@dataclass(frozen=True, kw_only=True)
class MachineNodeParameters(GraphParameters):
    """Parameters of the nodes that need a machine file."""

    machine: str = parameter("Machine file, or its name in config/machines.")


def load_parameters(cls: type[P], path: Path, node: str, *, beside: Iterable[str] = ()) -> P:
    """Fill a parameter dataclass from a ROS parameter file: section ``/**``, overridden by the node's own section.

    Args:
        cls: the dataclass.
        path: the file.
        node: name of the node.
        beside: parameters of the node in the file that do not belong to this dataclass.

    Raises:
        ConfigError: the file cannot be read, or as :func:`feedopt_core.schema.build`.
    """
    source = str(path)
    values = ros_parameters(parse_yaml(read_text(path), source), node, source)
    return build(cls, {key: value for key, value in values.items() if key not in beside}, source)


def declare_parameters(node: Node, cls: type[P]) -> P:
    """Fill a parameter dataclass from the start parameters of a node, and declare each of them read-only.

    The node must have been created with ``automatically_declare_parameters_from_overrides=True``.

    Raises:
        ConfigError: as :func:`feedopt_core.schema.build`.
    """
    given = {
        name: entry.value for name, entry in node.get_parameters_by_prefix("").items() if not name.startswith(_ROS_OWN)
    }
    parameters = build(cls, given, f"parameters of node {node.get_name()}")
    for entry in fields(cls):
        if node.has_parameter(entry.name):
            # An integer is accepted for a float: declare the parameter again with its correct type.
            node.undeclare_parameter(entry.name)
        value = getattr(parameters, entry.name)
        _declare(node, entry.name, value, _descriptor(value, rule_of(entry)))
    return parameters


def _descriptor(value: Any, rule: Rule) -> Any:
    # Imported here so that parameter files can be read without ROS.
    from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

    descriptor = ParameterDescriptor(description=rule.doc + (f" [{rule.unit}]" if rule.unit else ""), read_only=True)
    low, high = rule.at_least, rule.at_most
    if isinstance(value, bool) or (low is None and high is None):
        return descriptor
    if isinstance(value, float):
        from_value, to_value = (-math.inf if low is None else low), (math.inf if high is None else high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(from_value), to_value=float(to_value))]
    elif isinstance(value, int):
        from_value, to_value = (-(2**63) if low is None else low), (2**63 - 1 if high is None else high)
        descriptor.integer_range = [IntegerRange(from_value=int(from_value), to_value=int(to_value), step=1)]
    return descriptor


def _declare(node: Node, name: str, value: Any, descriptor: Any) -> None:
    from rclpy.parameter import Parameter

    if value == ():
        # An empty list has no type in ROS: declare the type without a value.
        value = Parameter.Type.STRING_ARRAY
    elif isinstance(value, tuple):
        value = list(value)
    node.declare_parameter(name, value, descriptor, ignore_override=True)
