"""Give a file that was cut off its index and footer back, in place.

Everything up to the last complete record is kept as it is; what follows is cut off, and the summary section that
readers look for is written behind it. Works for a recorder that was killed and for a disk that ran full.
"""

from __future__ import annotations

import os
import struct
from collections import Counter
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import ChunkIndex, MetadataIndex

from feedopt_recorder.bags.mcap_records import MAGIC, Frame, McapFile, walk_chunk
from feedopt_recorder.bags.mcap_summary import DataIndex, closing_bytes
from feedopt_recorder.bags.metadata_yaml import BagEntry, TopicEntry, write_metadata
from feedopt_recorder.errors import BagForeignError, BagMissingError, BagTruncatedError

_MESSAGE_INDEX_HEAD = struct.Struct("<HI")


def repair_bag(directory: Path) -> BagEntry:
    """Make a cut-off bag readable again and write its ``metadata.yaml``; a complete file only gets the latter.

    Args:
        directory: the bag's folder, with one MCAP file.

    Returns:
        What the bag holds now.

    Raises:
        BagMissingError, BagEmptyError, BagForeignError: there is no MCAP file to mend, or none of one file and chunks.
        OSError: the disk is full or the folder read-only.
    """
    path = _file_of(directory)
    with McapFile(path) as file:
        index, end_of_data = _index(file)
        complete = file.complete
    if not complete:
        _write_summary(path, index, end_of_data)
    bag = BagEntry(path.name, index.start_ns, index.end_ns, _topics(index))
    write_metadata(directory, bag)
    return bag


def _file_of(directory: Path) -> Path:
    files = sorted(directory.glob("*.mcap"))
    if not files:
        raise BagMissingError(f"{directory}: no MCAP file in this folder")
    if len(files) > 1:
        raise BagForeignError(f"{directory}: holds {len(files)} MCAP files; only bags of one file are mended")
    return files[0]


def _index(file: McapFile) -> tuple[DataIndex, int]:
    """What is whole in the file, and where that ends."""
    index, end_of_data = DataIndex(), len(MAGIC)
    for frame in file.frames():
        if frame.opcode == Opcode.CHUNK:
            chunk = _chunk_index(file, frame)
            try:
                content = file.chunk(frame)
            except BagTruncatedError:
                break
            records = walk_chunk(content)
            index.schemas.update((schema.id, schema) for schema in records.schemas)
            index.channels.update((channel.id, channel) for channel in records.channels)
            index.add_chunk(chunk, Counter(records.messages.channel.tolist()))
        elif frame.opcode == Opcode.MESSAGE_INDEX and index.chunks:
            channel_id, _ = _MESSAGE_INDEX_HEAD.unpack_from(file.data, frame.content)
            index.chunks[-1].message_index_offsets[channel_id] = frame.start
            index.chunks[-1].message_index_length += frame.end - frame.start
        elif frame.opcode == Opcode.MESSAGE:
            raise BagForeignError(f"{file.path}: has messages outside of chunks; feedopt writes none")
        elif frame.opcode == Opcode.METADATA:
            name = file.metadata(frame).name
            index.metadata.append(MetadataIndex(offset=frame.start, length=frame.end - frame.start, name=name))
        end_of_data = frame.end
    return index, end_of_data


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


def _write_summary(path: Path, index: DataIndex, end_of_data: int) -> None:
    with path.open("r+b") as stream:
        stream.truncate(end_of_data)
        stream.seek(end_of_data)
        stream.write(closing_bytes(index, end_of_data))
        stream.flush()
        os.fsync(stream.fileno())


def _topics(index: DataIndex) -> tuple[TopicEntry, ...]:
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
