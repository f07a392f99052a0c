"""The end of an MCAP file: what its data section holds, as the summary section that readers look for."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, DataEnd, MetadataIndex, Schema, Statistics

from feedopt_recorder.bags.mcap_records import MAGIC

# Opcode, length of the content, start of the summary, no summary offsets; a checksum of all that follows.
_FOOTER = struct.Struct("<BQQQ")
_FOOTER_CONTENT_BYTES = 20
_CRC = struct.Struct("<I")


@dataclass
class DataIndex:
    """What the data section of a file holds.

    Attributes:
        schemas, channels: by their numbers in the file.
        chunks, metadata: where each stands, in file order.
        counts: messages by channel.
        start_ns, end_ns: first and last log time.
    """

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    start_ns: int = 0
    end_ns: int = 0

    def add_chunk(self, index: ChunkIndex, counts: Mapping[int, int]) -> None:
        """Take in one more chunk and the number of its messages by channel."""
        self.start_ns = min(self.start_ns, index.message_start_time) if self.chunks else index.message_start_time
        self.end_ns = max(self.end_ns, index.message_end_time)
        self.counts.update(counts)
        self.chunks.append(index)


def closing_bytes(index: DataIndex, end_of_data: int) -> bytes:
    """Everything behind the data section: its end, the summary, the footer and the magic bytes.

    Args:
        index: what the data section holds.
        end_of_data: length of the file up to here, bytes.
    """
    data_end: Any = RecordBuilder()
    DataEnd(0).write(data_end)
    end_bytes: bytes = data_end.end()
    summary: Any = RecordBuilder()
    for records in (index.schemas.values(), index.channels.values(), index.chunks, index.metadata):
        for record in records:
            record.write(summary)
    Statistics(
        attachment_count=0,
        channel_count=len(index.channels),
        channel_message_counts=dict(index.counts),
        chunk_count=len(index.chunks),
        message_count=index.counts.total(),
        message_end_time=index.end_ns,
        message_start_time=index.start_ns,
        metadata_count=len(index.metadata),
        schema_count=len(index.schemas),
    ).write(summary)
    footer = _FOOTER.pack(Opcode.FOOTER, _FOOTER_CONTENT_BYTES, end_of_data + len(end_bytes), 0)
    checked: bytes = summary.end() + footer
    return end_bytes + checked + _CRC.pack(zlib.crc32(checked)) + MAGIC
