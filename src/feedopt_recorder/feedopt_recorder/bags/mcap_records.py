"""The records of an MCAP file, walked by their frames, so that a file that ends anywhere is readable up to there.

Every record is an opcode (1 byte), a length (8 bytes) and its content. Messages, channels and schemas stand inside
chunk records; the layout is that of the MCAP specification, version 0.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from feedopt_core.arrays import IntArray
from feedopt_recorder.errors import BagEmptyError, BagForeignError, BagMissingError, BagTruncatedError

MAGIC = b"\x89MCAP0\r\n"
_FRAME = struct.Struct("<BQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_LENGTH = struct.Struct("<Q")
MESSAGE_HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_ns", "<i8"),
        ("publish_ns", "<i8"),
    ]
)
_HEAD_IN_LENGTH = MESSAGE_HEAD.itemsize - _FRAME.size


@dataclass(frozen=True)
class Frame:
    """One top-level record: ``start`` is the offset of its opcode, the content runs from ``content`` to ``end``."""

    opcode: int
    start: int
    content: int
    end: int


class McapFile:
    """An MCAP file mapped into memory; a context manager.

    Attributes:
        complete: the file ends with its footer; known once :meth:`frames` ran to its end.
        end_of_records: offset behind the last complete record of the data section.

    Raises:
        BagMissingError: no such file, or it cannot be read.
        BagEmptyError: the file has no bytes.
        BagForeignError: the file does not start as an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.complete = False
        self.end_of_records = len(MAGIC)
        try:
            with path.open("rb") as stream:
                size = stream.seek(0, 2)
                if size == 0:
                    raise BagEmptyError(f"{path}: the file is empty: the recorder wrote nothing")
                self.data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
        except OSError as error:
            raise BagMissingError(f"{path}: cannot be read: {error.strerror}") from error
        if self.data[: len(MAGIC)] != MAGIC:
            self.data.close()
            raise BagForeignError(f"{path}: not an MCAP file")

    def __enter__(self) -> McapFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.data.close()

    def frames(self) -> Iterator[Frame]:
        """Complete records of the data section, in file order; stops at its end, or where the file breaks off."""
        position, size = len(MAGIC), len(self.data)
        self.complete = False
        while position + _FRAME.size <= size:
            opcode, length = _FRAME.unpack_from(self.data, position)
            content = position + _FRAME.size
            if opcode == Opcode.DATA_END:
                self.complete = content + length <= size and self.data[size - len(MAGIC) :] == MAGIC
                return
            if opcode == 0 or content + length > size:
                return
            frame = Frame(opcode, position, content, content + length)
            position = self.end_of_records = frame.end
            yield frame

    def metadata(self, frame: Frame) -> Metadata:
        """Content of a metadata record."""
        record: Metadata = Metadata.read(self._stream(frame))
        return record

    def chunk(self, frame: Frame) -> bytes:
        """Uncompressed content of a chunk record, its checksum verified.

        Raises:
            BagTruncatedError: the content is damaged.
            BagForeignError: it is compressed in a way that is not known here.
        """
        _, _, size, crc, name_length = _CHUNK_HEAD.unpack_from(self.data, frame.content)
        name_at = frame.content + _CHUNK_HEAD.size
        compression = self.data[name_at : name_at + name_length].decode()
        stored = self.data[name_at + name_length + 8 : frame.end]
        try:
            content = _uncompress(compression, stored, size)
        except (zstandard.ZstdError, RuntimeError) as error:
            raise BagTruncatedError(f"{self.path}: damaged chunk at byte {frame.start}: {error}") from error
        if content is None:
            raise BagForeignError(f"{self.path}: chunks are compressed with {compression!r}; known are zstd and lz4")
        if crc and zlib.crc32(content) != crc:
            raise BagTruncatedError(f"{self.path}: damaged chunk at byte {frame.start}: its checksum is wrong")
        return content

    def _stream(self, frame: Frame) -> ReadDataStream:
        return ReadDataStream(BytesIO(self.data[frame.content : frame.end]))


@dataclass(frozen=True)
class ChunkMessages:
    """The messages of one chunk in file order; arrays of shape (n,).

    Attributes:
        channel: channel id.
        log_ns, publish_ns: when each was received and sent.
        offset, length: where its payload stands in the uncompressed chunk, bytes.
    """

    channel: IntArray
    log_ns: IntArray
    publish_ns: IntArray
    offset: IntArray
    length: IntArray


@dataclass(frozen=True)
class ChunkRecords:
    """What one uncompressed chunk holds."""

    schemas: list[Schema]
    channels: list[Channel]
    messages: ChunkMessages


def walk_chunk(content: bytes) -> ChunkRecords:
    """Split an uncompressed chunk into its records."""
    schemas: list[Schema] = []
    channels: list[Channel] = []
    starts: list[int] = []
    position, size, unpack, message = 0, len(content), _LENGTH.unpack_from, int(Opcode.MESSAGE)
    while position < size:
        opcode, start = content[position], position + _FRAME.size
        end = start + unpack(content, position + 1)[0]
        if opcode == message:
            starts.append(position)
        elif opcode == Opcode.SCHEMA:
            schemas.append(Schema.read(ReadDataStream(BytesIO(content[start:end]))))
        elif opcode == Opcode.CHANNEL:
            channels.append(Channel.read(ReadDataStream(BytesIO(content[start:end]))))
        position = end
    return ChunkRecords(schemas, channels, _messages(content, np.array(starts, dtype=np.int64)))


def _messages(content: bytes, starts: IntArray) -> ChunkMessages:
    if not len(starts):
        return ChunkMessages(*(np.empty(0, dtype=np.int64) for _ in range(5)))
    windows = np.lib.stride_tricks.sliding_window_view(np.frombuffer(content, dtype=np.uint8), MESSAGE_HEAD.itemsize)
    heads = windows[starts].view(MESSAGE_HEAD)[:, 0]
    return ChunkMessages(
        channel=heads["channel"].astype(np.int64),
        log_ns=heads["log_ns"],
        publish_ns=heads["publish_ns"],
        offset=starts + MESSAGE_HEAD.itemsize,
        length=heads["length"].astype(np.int64) - _HEAD_IN_LENGTH,
    )


def _uncompress(compression: str, stored: bytes, size: int) -> bytes | None:
    if compression == "zstd":
        return zstandard.decompress(stored, size)
    if compression == "lz4":
        content: bytes = lz4.frame.decompress(stored)
        return content
    return stored if compression == "" else None
