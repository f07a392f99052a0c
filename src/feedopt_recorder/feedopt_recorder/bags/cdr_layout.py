"""Where the fields of a CDR message stand when all its arrays keep their length: a numpy dtype for thousands at once.

CDR (XCDR1, little endian, as ROS 2 sends it): a 4-byte header, then every primitive aligned to its own size, counted
from behind the header; a sequence is a uint32 length and its elements.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

HEADER_BYTES = 4
_TYPES = {
    "bool": "?",
    "byte": "u1",
    "octet": "u1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "<i2",
    "uint16": "<u2",
    "int32": "<i4",
    "uint32": "<u4",
    "int64": "<i8",
    "uint64": "<u8",
    "float32": "<f4",
    "float64": "<f8",
}
_LENGTH = struct.Struct("<I")

TypeDefinitions = Mapping[str, Any]
"""Type name to (constants, fields), as ``rosbags.typesys.get_types_from_msg`` gives them."""


class NoFixedLayoutError(Exception):
    """A message with strings or arrays of messages: its layout changes with its content. Stays in this package."""


@dataclass
class CdrLayout:
    """Layout of one message.

    Attributes:
        names, formats, offsets: fields of the dtype; a nested field is ``outer.inner``, a length is ``#field``.
        lengths: value of every length field; messages with other lengths have another layout.
        empty: fields that are sequences of length 0.
    """

    names: list[str] = field(default_factory=list)
    formats: list[Any] = field(default_factory=list)
    offsets: list[int] = field(default_factory=list)
    lengths: dict[str, int] = field(default_factory=dict)
    empty: list[str] = field(default_factory=list)
    end: int = HEADER_BYTES

    def dtype(self, message_bytes: int) -> np.dtype[np.void]:
        """The dtype of messages of that size."""
        spec = {"names": self.names, "formats": self.formats, "offsets": self.offsets, "itemsize": message_bytes}
        return np.dtype(spec)  # type: ignore[call-overload, no-any-return]

    def take(self, name: str, kind: str, shape: tuple[int, ...] = ()) -> int:
        """Append one field at its aligned place and return its offset."""
        plain = np.dtype(kind)
        start = HEADER_BYTES + -(-(self.end - HEADER_BYTES) // plain.itemsize) * plain.itemsize
        self.names.append(name)
        self.formats.append((kind, shape) if shape else kind)
        self.offsets.append(start)
        self.end = start + plain.itemsize * int(np.prod(shape, dtype=int))
        return start


def layout_of(types: TypeDefinitions, type_name: str, payload: bytes) -> CdrLayout:
    """Layout of one message, with the array lengths it has.

    Raises:
        NoFixedLayoutError: the type holds strings or arrays of messages, or the payload is not little-endian CDR.
    """
    if len(payload) < HEADER_BYTES or payload[1] != 1:
        raise NoFixedLayoutError(f"{type_name}: not little-endian CDR")
    layout = CdrLayout()
    _walk(layout, types, type_name, payload, "")
    if not 0 <= len(payload) - layout.end < HEADER_BYTES:
        raise NoFixedLayoutError(f"{type_name}: {len(payload)} bytes where {layout.end} were due")
    return layout


def _walk(layout: CdrLayout, types: TypeDefinitions, type_name: str, payload: bytes, prefix: str) -> None:
    for name, (node, detail) in types[type_name][1]:
        full = prefix + name
        if node == Nodetype.NAME:
            _walk(layout, types, detail, payload, full + ".")
        elif node == Nodetype.BASE:
            layout.take(full, _primitive(detail, full))
        elif node == Nodetype.ARRAY:
            (element, kind), count = detail
            layout.take(full, _element(element, kind, full), (count,))
        else:
            (element, kind), _ = detail
            plain = _element(element, kind, full)
            offset = layout.take("#" + full, "<u4")
            if offset + _LENGTH.size > len(payload):
                raise NoFixedLayoutError(f"{full}: the message ends before it")
            (count,) = _LENGTH.unpack_from(payload, offset)
            layout.lengths["#" + full] = count
            if count:
                layout.take(full, plain, (count,))
            else:
                layout.empty.append(full)


def _element(node: Nodetype, detail: Any, name: str) -> str:
    if node != Nodetype.BASE:
        raise NoFixedLayoutError(f"{name} is an array of messages")
    return _primitive(detail, name)


def _primitive(detail: tuple[str, int], name: str) -> str:
    try:
        return _TYPES[detail[0]]
    except KeyError as error:
        raise NoFixedLayoutError(f"{name} is a {detail[0]}") from error
