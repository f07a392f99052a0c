"""Writes MCAP files of zstd chunks, cheap enough for many thousand messages a second.

The writer of the mcap package builds an object and makes a dozen calls for each message. Here a message is one packed
head and its payload, and the rest is done once per chunk: less than half of the processor time (docs/decisions/0018).
"""

from __future__ import annotations

import struct
import zlib
from typing import Any, Protocol

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Header, Metadata, MetadataIndex, Schema

from feedopt_recorder.bags.mcap_records import MAGIC, MESSAGE_HEAD
from feedopt_recorder.bags.mcap_summary import DataIndex, closing_bytes

CHUNK_BYTES = 256 * 1024
_FRAME_BYTES = 9
_PACK_HEAD = struct.Struct("<BQHIQQ").pack
_MESSAGE_INDEX = struct.Struct("<BQHI")
_INDEX_ROW = np.dtype([("log_ns", "<u8"), ("offset", "<u8")])


class ByteSink(Protocol):
    """Where the bytes go."""

    def write(self, data: bytes) -> int:
        """Take all of them, or raise OSError."""

    def tell(self) -> int:
        """How many were taken."""


class McapWriter:
    """One MCAP file, written from its start to its end.

    Every method that writes raises OSError; what was written before stays readable up to the last whole chunk.

    Args:
        sink: takes the bytes.
        library: what the file says it was written by.
    """

    def __init__(self, sink: ByteSink, library: str) -> None:
        self._sink = sink
        self._index = DataIndex()
        self._parts: list[bytes] = []
        self._held_bytes = 0
        # Schemas and channels stand in the first chunk, before the messages that need them.
        self._declarations: Any = RecordBuilder()
        self._write_record(Header(profile="ros2", library=library), lead=MAGIC)

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Write one metadata record."""
        offset = self._sink.tell()
        length = self._write_record(Metadata(name=name, metadata=values))
        self._index.metadata.append(MetadataIndex(offset=offset, length=length, name=name))

    def add_schema(self, name: str, text: str) -> int:
        """Declare a message type by its ``ros2msg`` definition; returns its number."""
        schema = Schema(id=len(self._index.schemas) + 1, name=name, encoding="ros2msg", data=text.encode())
        self._index.schemas[schema.id] = schema
        schema.write(self._declarations)
        return int(schema.id)

    def add_channel(self, topic: str, schema_id: int, metadata: dict[str, str]) -> int:
        """Declare a topic of CDR messages; returns its number."""
        number = len(self._index.channels) + 1
        channel = Channel(id=number, topic=topic, message_encoding="cdr", metadata=metadata, schema_id=schema_id)
        self._index.channels[number] = channel
        channel.write(self._declarations)
        return number

    def add_message(self, channel: int, payload: bytes, log_ns: int, publish_ns: int, sequence: int) -> None:
        """Add one message to the chunk in progress, and close that when it is full."""
        length = len(payload)
        self._parts.append(_PACK_HEAD(Opcode.MESSAGE, length + 22, channel, sequence, log_ns, publish_ns))
        self._parts.append(payload)
        self._held_bytes += length
        if self._held_bytes >= CHUNK_BYTES:
            self.close_chunk()

    def close_chunk(self) -> None:
        """Write the chunk in progress, if it holds a message."""
        if not self._parts:
            return
        parts, self._parts, self._held_bytes = self._parts, [], 0
        declarations: bytes = self._declarations.end()
        heads = np.frombuffer(b"".join(parts[::2]), dtype=MESSAGE_HEAD)
        offsets = np.empty(len(heads), dtype=np.uint64)
        offsets[0] = len(declarations)
        np.cumsum(heads["length"][:-1] + _FRAME_BYTES, out=offsets[1:])
        offsets[1:] += offsets[0]
        self._write_chunk(declarations + b"".join(parts), heads, offsets)

    def finish(self) -> None:
        """Write the last chunk, the summary and the footer."""
        self.close_chunk()
        self._sink.write(closing_bytes(self._index, self._sink.tell()))

    def _write_chunk(self, content: bytes, heads: np.ndarray[Any, Any], offsets: np.ndarray[Any, Any]) -> None:
        start = self._sink.tell()
        compressed = zstandard.compress(content)
        chunk = Chunk(
            compression="zstd",
            data=compressed,
            message_start_time=int(heads["log_ns"].min()),
            message_end_time=int(heads["log_ns"].max()),
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        )
        chunk_length = self._write_record(chunk)
        records, places, counts = bytearray(), {}, {}
        for channel in np.unique(heads["channel"]).tolist():
            mine = np.flatnonzero(heads["channel"] == channel)
            rows = np.empty(len(mine), dtype=_INDEX_ROW)
            rows["log_ns"], rows["offset"] = heads["log_ns"][mine], offsets[mine]
            places[channel], counts[channel] = start + chunk_length + len(records), len(mine)
            records += _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, rows.nbytes + 6, channel, rows.nbytes)
            records += rows.tobytes()
        self._sink.write(bytes(records))
        index = ChunkIndex(
            chunk_length=chunk_length,
            chunk_start_offset=start,
            compression=chunk.compression,
            compressed_size=len(compressed),
            message_end_time=chunk.message_end_time,
            message_index_length=len(records),
            message_index_offsets=places,
            message_start_time=chunk.message_start_time,
            uncompressed_size=len(content),
        )
        self._index.add_chunk(index, counts)

    def _write_record(self, record: Any, lead: bytes = b"") -> int:
        builder: Any = RecordBuilder()
        record.write(builder)
        content: bytes = builder.end()
        self._sink.write(lead + content)
        return len(content)
