"""Message definitions of a bag against those of this version: equal, migrated by a rule, or refused by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from feedopt_msgs.msg import Failure as FailureMessage
from feedopt_recorder.bags.cdr_layout import TypeDefinitions
from feedopt_recorder.errors import BagDefinitionError

_PRIMITIVES = {"float64": "double", "float32": "float", "bool": "boolean", "byte": "octet", "char": "uint8"}


def _migrate_segment(message: Any) -> None:
    """Before dwells, rapids and events were carried, there were none."""
    message.dwell_s, message.rapid, message.events = 0.0, False, []


def _migrate_chunk(message: Any) -> None:
    """Before dwells were carried, there were none; which solver found a plan was not said."""
    message.dwell_s, message.solver = 0.0, ""


def _migrate_machine(message: Any) -> None:
    """Before axes could mix coordinates, each followed one: its row of the axis map has a single 1. No reserve yet."""
    _migrate_period(message)
    rows = np.eye(int(max(message.coordinate)) + 1)
    message.tracking_error_reserve_mm = np.empty(0)
    message.axis_map = rows[np.asarray(message.coordinate, dtype=np.intp)].ravel()


def _migrate_period(message: Any) -> None:
    """Before the machine carried its period, set points came every millisecond."""
    message.period_s = 0.001


def _migrate_status(message: Any) -> None:
    """Before failures were fields, the text of a FAULT said all."""
    message.failure = FailureMessage()


MIGRATIONS: Mapping[tuple[str, frozenset[str], frozenset[str]], Callable[[Any], None]] = {
    (
        "feedopt_msgs/msg/ToolpathSegment",
        frozenset(),
        frozenset({"dwell_s", "rapid", "events"}),
    ): _migrate_segment,
    ("feedopt_msgs/msg/FeedProfileChunk", frozenset(), frozenset({"dwell_s", "solver"})): _migrate_chunk,
    (
        "feedopt_msgs/msg/Machine",
        frozenset({"coordinate"}),
        frozenset({"axis_map", "tracking_error_reserve_mm", "period_s"}),
    ): _migrate_machine,
    ("feedopt_msgs/msg/Machine", frozenset(), frozenset({"period_s"})): _migrate_period,
    ("feedopt_msgs/msg/NodeStatus", frozenset(), frozenset({"failure"})): _migrate_status,
}
"""Type, fields that only the bag has, fields that only this version has: what makes one of the other."""


def fields_of(definitions: TypeDefinitions, type_name: str) -> dict[str, str]:
    """Fields of a recorded definition with their types, as the installed message classes spell them."""
    return {name: _spelled(node, detail) for name, (node, detail) in definitions[type_name][1]}


def migration(definitions: TypeDefinitions, type_name: str) -> Callable[[Any], None] | None:
    """What makes a recorded message one of this version; None where the definitions agree.

    Args:
        definitions: of the bag, with all that the type uses.
        type_name: such as ``feedopt_msgs/msg/AxisState``.

    Raises:
        BagDefinitionError: a field changed its type, a constant its value, or fields came and went without a rule.
    """
    current = _installed_class(type_name)
    recorded, known = fields_of(definitions, type_name), current.get_fields_and_field_types()
    for name in recorded.keys() & known.keys():
        if recorded[name] != known[name]:
            raise _refusal(type_name, f"its field {name} is {recorded[name]}, here it is {known[name]}")
    for name, _, value in definitions[type_name][0]:
        here = getattr(current, name, value)
        # A constant of type byte is a byte string in the message class.
        if (int.from_bytes(here, "little") if isinstance(here, bytes) else here) != value:
            raise _refusal(type_name, f"its constant {name} is {value}, here it is {here}")
    for _, (node, detail) in definitions[type_name][1]:
        if (nested := _nested(node, detail)) and migration(definitions, nested):
            raise _refusal(type_name, f"{nested} in it has other fields")
    gone, new = frozenset(recorded.keys() - known.keys()), frozenset(known.keys() - recorded.keys())
    if not gone and not new:
        return None
    rule = MIGRATIONS.get((type_name, gone, new))
    if rule is None:
        parts = [f"it {'has' if kind is gone else 'lacks'} {', '.join(sorted(kind))}" for kind in (gone, new) if kind]
        raise _refusal(type_name, " and ".join(parts))
    return rule


def migrated(definitions: TypeDefinitions, type_name: str, messages: Sequence[Any]) -> Sequence[Any]:
    """Recorded messages as messages of this version, changed in place. Raises BagDefinitionError."""
    rule = migration(definitions, type_name)
    if rule is not None:
        for message in messages:
            rule(message)
    return messages


def _refusal(type_name: str, difference: str) -> BagDefinitionError:
    return BagDefinitionError(
        f"{type_name} of this bag is another one than that of this version: {difference}; "
        "read the bag with the version that recorded it, which stands in feedopt/versions, or record the run again"
    )


def _installed_class(type_name: str) -> Any:
    package, folder, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), name)
    except (ImportError, AttributeError) as error:
        raise BagDefinitionError(f"{type_name} of this bag is not installed here: {error}") from error


def _spelled(node: Nodetype, detail: Any) -> str:
    if node == Nodetype.BASE:
        name, bound = detail
        return f"{_PRIMITIVES.get(name, name)}<{bound}>" if bound else _PRIMITIVES.get(name, name)
    if node == Nodetype.NAME:
        return str(detail).replace("/msg/", "/")
    (element_node, element), size = detail
    spelled = _spelled(element_node, element)
    if node == Nodetype.ARRAY:
        return f"{spelled}[{size}]"
    return f"sequence<{spelled}, {size}>" if size else f"sequence<{spelled}>"


def _nested(node: Nodetype, detail: Any) -> str:
    """The message type a field is made of; empty for primitives."""
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        node, detail = detail[0]
    return str(detail) if node == Nodetype.NAME else ""
