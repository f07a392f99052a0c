"""Messages of a bag, by topic: thousands of one layout at once as numpy columns, any other one by one."""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mcap.opcode import Opcode
from mcap.records import Channel
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from feedopt_core.arrays import IntArray
from feedopt_recorder.bags.cdr_layout import NoFixedLayoutError, layout_of
from feedopt_recorder.bags.mcap_records import McapFile, walk_chunk
from feedopt_recorder.bags.metadata_yaml import FILE_NAME
from feedopt_recorder.errors import BagEmptyError, BagForeignError, BagMissingError, BagTruncatedError
from feedopt_recorder.run_folder import BAG_NAME


@dataclass
class TopicMessages:
    """The messages of one topic, in file order, still serialised.

    Attributes:
        log_ns, publish_ns: when each was received and sent, shape (n,).
        blocks: payloads, one (messages, bytes) array of uint8 for each run of messages of one size.
    """

    name: str
    type_name: str
    definitions: dict[str, Any]
    log_ns: IntArray
    publish_ns: IntArray
    blocks: list[np.ndarray[Any, np.dtype[np.uint8]]]

    def __len__(self) -> int:
        return len(self.log_ns)

    def columns(self) -> dict[str, np.ndarray[Any, Any]]:
        """Every field as one array, shape (n,) or (n, length); nested fields read ``outer.inner``.

        Raises:
            BagForeignError: the messages do not share one layout.
        """
        sizes = {block.shape[1] for block in self.blocks}
        if len(sizes) != 1:
            raise BagForeignError(f"{self.name}: messages of {len(sizes)} different sizes: the number of axes changes")
        data = np.concatenate(self.blocks)
        try:
            layout = layout_of(self.definitions, self.type_name, data[0].tobytes())
        except NoFixedLayoutError as error:
            raise BagForeignError(f"{self.name}: {error}") from error
        rows = data.view(layout.dtype(data.shape[1]))[:, 0]
        for name, length in layout.lengths.items():
            if not np.all(rows[name] == length):
                raise BagForeignError(f"{self.name}: the length of {name[1:]} changes from message to message")
        found = {name: np.ascontiguousarray(rows[name]) for name in layout.names if not name.startswith("#")}
        return {**found, **{name: np.empty((len(data), 0)) for name in layout.empty}}

    def objects(self) -> list[Any]:
        """Every message as an object with the fields of its type, deserialised by rosbags.

        Raises:
            BagForeignError: a message that is not what its definition says.
        """
        store = get_typestore(Stores.EMPTY)
        store.register(self.definitions)
        try:
            return [store.deserialize_cdr(row.tobytes(), self.type_name) for block in self.blocks for row in block]
        except (SerdeError, struct.error, ValueError, IndexError) as error:
            raise BagForeignError(f"{self.name}: a message is no {self.type_name}: {error}") from error


@dataclass
class BagContents:
    """A bag in memory: topics, provenance records, and whether the file has its footer."""

    path: Path
    topics: dict[str, TopicMessages]
    metadata: dict[str, dict[str, str]]
    complete: bool


@dataclass
class _Collected:
    """Pieces gathered while the chunks pass by, by channel."""

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, tuple[str, str, str]] = field(default_factory=dict)
    log_ns: defaultdict[int, list[IntArray]] = field(default_factory=lambda: defaultdict(list))
    publish_ns: defaultdict[int, list[IntArray]] = field(default_factory=lambda: defaultdict(list))
    blocks: defaultdict[int, list[np.ndarray[Any, Any]]] = field(default_factory=lambda: defaultdict(list))
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)


def read_messages(path: Path, topics: Sequence[str] | None = None, *, allow_truncated: bool = False) -> BagContents:
    """Read a bag: its folder, or one MCAP file.

    Args:
        path: folder or file.
        topics: names of the topics to keep; None: all.
        allow_truncated: take what is there of a file that was cut off, instead of raising.

    Raises:
        BagMissingError: nothing there, or a folder without an MCAP file.
        BagEmptyError: no message.
        BagForeignError: not MCAP, or not CDR messages with their definitions.
        BagTruncatedError: cut off or damaged.
    """
    topic_messages: dict[str, TopicMessages] = {}
    metadata: dict[str, dict[str, str]] = {}
    complete, empty = True, True
    for file_path in bag_files(path):
        collected = _Collected()
        with McapFile(file_path) as file:
            _collect(file, collected, allow_truncated)
            complete = complete and file.complete
        empty = empty and not collected.log_ns
        if not complete and not allow_truncated:
            raise BagTruncatedError(
                f"{file_path}: the file ends without its footer: the recorder was killed; "
                f"mend it with: feedopt bag recover {path}"
            )
        metadata.update(collected.metadata)
        _merge(topic_messages, _topics(collected, file_path, topics))
    if empty:
        raise BagEmptyError(f"{path}: the bag holds no message")
    return BagContents(path, topic_messages, metadata, complete)


def bag_files(path: Path) -> list[Path]:
    """The MCAP files of a bag, in order.

    Args:
        path: the bag's folder, the folder of a run that has one, or one MCAP file.

    Raises:
        BagMissingError, BagForeignError: nothing there, or no MCAP.
    """
    if path.is_file():
        return [path]
    if not (path / FILE_NAME).is_file() and (path / BAG_NAME).is_dir():
        path = path / BAG_NAME
    if not path.is_dir():
        raise BagMissingError(f"{path}: no such bag")
    listed: list[str] = []
    if (path / FILE_NAME).is_file():
        try:
            document = yaml.safe_load((path / FILE_NAME).read_text(encoding="utf-8"))
            listed = list(document["rosbag2_bagfile_information"]["relative_file_paths"])
        except (yaml.YAMLError, KeyError, TypeError) as error:
            raise BagForeignError(f"{path / FILE_NAME}: not the metadata of a rosbag2 bag") from error
    files = [path / name for name in listed] or sorted(path.glob("*.mcap"))
    if not files:
        raise BagMissingError(f"{path}: no MCAP file in this folder")
    if foreign := next((file for file in files if file.suffix != ".mcap"), None):
        raise BagForeignError(f"{foreign}: only MCAP bags are read; convert it with: ros2 bag convert")
    return files


def _collect(file: McapFile, collected: _Collected, allow_truncated: bool) -> None:
    for frame in file.frames():
        if frame.opcode == Opcode.METADATA:
            record = file.metadata(frame)
            collected.metadata[record.name] = record.metadata
        elif frame.opcode == Opcode.CHUNK:
            try:
                content = file.chunk(frame)
            except BagTruncatedError:
                if allow_truncated:
                    file.complete = False
                    return
                raise
            _collect_chunk(content, collected)


def _collect_chunk(content: bytes, collected: _Collected) -> None:
    records = walk_chunk(content)
    for schema in records.schemas:
        collected.schemas[schema.id] = (schema.name, schema.encoding, schema.data.decode())
    for channel in records.channels:
        collected.channels[channel.id] = channel
    messages = records.messages
    data = np.frombuffer(content, dtype=np.uint8)
    for channel_id in set(messages.channel.tolist()):
        mine = np.flatnonzero(messages.channel == channel_id)
        collected.log_ns[channel_id].append(messages.log_ns[mine])
        collected.publish_ns[channel_id].append(messages.publish_ns[mine])
        # Runs of one size become one block; a fixed layout is a single run.
        edges = np.flatnonzero(np.diff(messages.length[mine])) + 1
        for run in np.split(mine, edges):
            windows = np.lib.stride_tricks.sliding_window_view(data, int(messages.length[run[0]]))
            collected.blocks[channel_id].append(windows[messages.offset[run]])


def _topics(collected: _Collected, path: Path, names: Sequence[str] | None) -> list[TopicMessages]:
    topics = []
    for channel_id, channel in collected.channels.items():
        if names is not None and channel.topic not in names:
            continue
        type_name, encoding, text = collected.schemas.get(channel.schema_id, ("", "", ""))
        if channel.message_encoding != "cdr" or encoding != "ros2msg":
            raise BagForeignError(
                f"{path}: topic {channel.topic} is {channel.message_encoding or 'unknown'} "
                f"with {encoding or 'no'} definition; only CDR with ros2msg definitions is read"
            )
        topics.append(
            TopicMessages(
                name=channel.topic,
                type_name=type_name,
                definitions=get_types_from_msg(text, type_name),
                log_ns=_joined(collected.log_ns[channel_id]),
                publish_ns=_joined(collected.publish_ns[channel_id]),
                blocks=collected.blocks[channel_id],
            )
        )
    return topics


def _joined(pieces: list[IntArray]) -> IntArray:
    return np.concatenate(pieces) if pieces else np.empty(0, dtype=np.int64)


def _merge(into: dict[str, TopicMessages], topics: list[TopicMessages]) -> None:
    for topic in topics:
        if (known := into.get(topic.name)) is None:
            into[topic.name] = topic
        elif known.type_name != topic.type_name:
            raise BagForeignError(f"{topic.name} has two types: {known.type_name} and {topic.type_name}")
        else:
            known.log_ns = np.concatenate([known.log_ns, topic.log_ns])
            known.publish_ns = np.concatenate([known.publish_ns, topic.publish_ns])
            known.blocks += topic.blocks
