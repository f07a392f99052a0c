"""Give a file that was cut off its index and footer back, in place.

Everything up to the last complete record is kept as it is; what follows is cut off, and the summary section that
readers look for is written behind it. Works for a recorder that was killed and for a disk that ran full.
"""

from __future__ import annotations

import os
import struct
import sys
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, DataEnd, Footer, MetadataIndex, Schema, Statistics

from feedopt_tools.bags.errors import BagError, BagTruncatedError
from feedopt_tools.bags.mcap_records import MAGIC, Frame, McapFile, walk_chunk
from feedopt_tools.bags.metadata_yaml import BagEntry, TopicEntry, write_metadata

_MESSAGE_INDEX_HEAD = struct.Struct("<HI")


@dataclass
class _Index:
    """What the summary section says about the data section."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    counts: defaultdict[int, int] = field(default_factory=lambda: defaultdict(int))
    start_ns: int = 0
    end_ns: int = 0
    end_of_records: int = len(MAGIC)

    def add_chunk(self, content: bytes, index: ChunkIndex) -> None:
        records = walk_chunk(content)
        self.schemas.update((schema.id, schema) for schema in records.schemas)
        self.channels.update((channel.id, channel) for channel in records.channels)
        for channel_id in records.messages.channel.tolist():
            self.counts[channel_id] += 1
        self.start_ns = min(self.start_ns, index.message_start_time) if self.chunks else index.message_start_time
        self.end_ns = max(self.end_ns, index.message_end_time)
        self.chunks.append(index)


def repair_bag(directory: Path) -> BagEntry:
    """Make a cut-off bag readable again and write its ``metadata.yaml``; a complete file only gets the latter.

    Args:
        directory: the bag's folder; its file is ``<folder name>_0.mcap``.

    Returns:
        What the bag holds now.

    Raises:
        BagMissingError, BagEmptyError, BagForeignError: there is no MCAP file to mend.
        OSError: the disk is full or the folder read-only.
    """
    path = directory / f"{directory.name}_0.mcap"
    with McapFile(path) as file:
        index = _index(file)
        complete = file.complete
    if not complete:
        _write_summary(path, index)
    bag = BagEntry(path.name, index.start_ns, index.end_ns, _topics(index))
    write_metadata(directory, bag)
    return bag


def _index(file: McapFile) -> _Index:
    index = _Index()
    for frame in file.frames():
        if frame.opcode == Opcode.CHUNK:
            chunk = _chunk_index(file, frame)
            try:
                content = file.chunk(frame)
            except BagTruncatedError:
                break
            index.add_chunk(content, chunk)
        elif frame.opcode == Opcode.MESSAGE_INDEX and index.chunks:
            channel_id, _ = _MESSAGE_INDEX_HEAD.unpack_from(file.data, frame.content)
            index.chunks[-1].message_index_offsets[channel_id] = frame.start
            index.chunks[-1].message_index_length += frame.end - frame.start
        elif frame.opcode == Opcode.METADATA:
            name = file.metadata(frame).name
            index.metadata.append(MetadataIndex(offset=frame.start, length=frame.end - frame.start, name=name))
        index.end_of_records = frame.end
    return index


def _chunk_index(file: McapFile, frame: Frame) -> ChunkIndex:
    start_ns, end_ns, size, _, name_length = struct.unpack_from("<QQQII", file.data, frame.content)
    name_at = frame.content + 32
    return ChunkIndex(
        chunk_length=frame.end - frame.start,
        chunk_start_offset=frame.start,
        compression=file.data[name_at : name_at + name_length].decode(),
        compressed_size=frame.end - (name_at + name_length + 8),
        message_end_time=end_ns,
        message_index_length=0,
        message_index_offsets={},
        message_start_time=start_ns,
        uncompressed_size=size,
    )


def _write_summary(path: Path, index: _Index) -> None:
    data_end: Any = RecordBuilder()
    DataEnd(0).write(data_end)
    end_bytes = data_end.end()
    summary: Any = RecordBuilder()
    for records in (index.schemas.values(), index.channels.values(), index.chunks, index.metadata):
        for record in records:
            record.write(summary)
    Statistics(
        attachment_count=0,
        channel_count=len(index.channels),
        channel_message_counts=dict(index.counts),
        chunk_count=len(index.chunks),
        message_count=sum(index.counts.values()),
        message_end_time=index.end_ns,
        message_start_time=index.start_ns,
        metadata_count=len(index.metadata),
        schema_count=len(index.schemas),
    ).write(summary)
    footer: Any = RecordBuilder()
    Footer(summary_start=index.end_of_records + len(end_bytes), summary_offset_start=0, summary_crc=0).write(footer)
    with path.open("r+b") as stream:
        stream.truncate(index.end_of_records)
        stream.seek(index.end_of_records)
        stream.write(end_bytes + summary.end() + footer.end() + MAGIC)
        stream.flush()
        os.fsync(stream.fileno())


def _topics(index: _Index) -> tuple[TopicEntry, ...]:
    return tuple(
        TopicEntry(
            name=channel.topic,
            type_name=index.schemas[channel.schema_id].name,
            type_hash=channel.metadata.get("topic_type_hash", ""),
            offered_qos_profiles=channel.metadata.get("offered_qos_profiles", ""),
            message_count=index.counts[channel.id],
        )
        for channel in index.channels.values()
    )


def main() -> None:
    """Mend the bag named on the command line."""
    if len(sys.argv) != 2:
        sys.exit("usage: python -m feedopt_tools.bags.repair BAG")
    try:
        bag = repair_bag(Path(sys.argv[1]).absolute())
    except (BagError, OSError) as error:
        sys.exit(f"repair: {error}")
    sys.stdout.write(f"{bag.file_name}: {sum(topic.message_count for topic in bag.topics)} messages\n")


if __name__ == "__main__":
    main()
