"""Messages as columns: one list of values for each field name, for messages of rclpy and of rosbags alike."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

_PLAIN = (bool, int, float, str, bytes, np.generic)


@dataclass
class Columns:
    """Fields of the messages of one topic, in order.

    Attributes:
        count: number of messages.
        values: one entry a message for every field; nested fields read ``outer.inner``, those of a sequence of
            messages ``outer[].inner`` with one array a message.
    """

    count: int = 0
    values: dict[str, list[Any]] = field(default_factory=dict)

    def add(self, message: Any) -> None:
        """Add one message. The values are copied: the caller may reuse the message."""
        for name, value in _flat(message, ""):
            self.values.setdefault(name, []).append(value)
        self.count += 1

    def find(self, name: str, index: int) -> Any:
        """Value of a field of one message; None if the message has no such field."""
        column = self.values.get(name)
        return None if column is None or index >= len(column) else column[index]


def columns_of(messages: Iterable[Any]) -> Columns:
    """Columns of messages of one type."""
    columns = Columns()
    for message in messages:
        columns.add(message)
    return columns


def columns_of_arrays(arrays: Mapping[str, Any], count: int) -> Columns:
    """Columns of messages that were read as arrays, one row a message."""
    return Columns(count, {name: list(values) for name, values in arrays.items()})


def _flat(message: Any, prefix: str) -> Iterable[tuple[str, Any]]:
    for name in _field_names(message):
        value = getattr(message, name)
        full = prefix + name
        if isinstance(value, _PLAIN):
            yield full, value
        elif isinstance(value, array):
            yield full, np.array(value)
        elif isinstance(value, np.ndarray):
            yield full, value
        elif isinstance(value, (list, tuple)):
            yield from _flat_sequence(value, full)
        else:
            yield from _flat(value, full + ".")


def _flat_sequence(items: list[Any] | tuple[Any, ...], name: str) -> Iterable[tuple[str, Any]]:
    if not items or isinstance(items[0], _PLAIN):
        yield name, np.asarray(items, dtype=object if items and isinstance(items[0], str) else None)
        return
    yield name + "[]", len(items)
    columns = columns_of(items)
    for inner, values in columns.values.items():
        yield f"{name}[].{inner}", np.asarray(values)


def _field_names(message: Any) -> Iterable[str]:
    if hasattr(message, "get_fields_and_field_types"):
        names: Iterable[str] = message.get_fields_and_field_types()
        return names
    return [name for name in message.__dataclass_fields__ if not name.startswith("__")]
