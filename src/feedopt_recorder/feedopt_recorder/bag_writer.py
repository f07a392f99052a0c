"""Writes a bag: a folder with one MCAP file and ``metadata.yaml``, as rosbag2 lays it out. Free of ROS."""

from __future__ import annotations

import os
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, NamedTuple

import yaml

from feedopt_node.graph import Topic
from feedopt_recorder.bags.metadata_yaml import (
    BagEntry,
    TopicEntry,
    bag_information,
    package_version,
    qos_profiles_yaml,
    write_metadata,
)
from feedopt_recorder.bags.repair import repair_bag
from feedopt_recorder.errors import BagError, BagWriteError
from feedopt_recorder.mcap_writer import McapWriter
from feedopt_recorder.message_schemas import MessageSchemas

# Disk space for the index and metadata.yaml of an hour's recording, released when the disk is full.
RESERVE_BYTES = 2 * 1024 * 1024
FLUSH_INTERVAL_S = 0.4
"""A chunk is closed at the latest after this time, unless the caller gives another one."""


class Received(NamedTuple):
    """One message as the middleware handed it over; sorts by the time it was received.

    Attributes:
        log_ns, publish_ns: when it was received and sent, ns since the epoch.
        topic: one of the topics of the bag.
        payload: the CDR bytes as received, with their 4-byte header.
        publisher_sequence: number the middleware gave it.
    """

    log_ns: int
    publish_ns: int
    topic: str
    payload: bytes
    publisher_sequence: int


class BagWriter:
    """A bag that is being written; every chunk that left the process is readable, whatever happens next.

    Args:
        directory: folder of the bag; it must not exist yet, or be empty.
        topics: every topic to record; each gets a channel, with messages or without.
        schemas: where the message definitions come from.
        provenance: MCAP metadata records, name to keys and values, written first.
        flush_interval_s: a chunk is closed at the latest after this time.
        clock_s: monotonic clock.

    Raises:
        BagWriteError: the folder holds something already, or cannot be written.
        ConfigError: the definition of a message is not installed.
    """

    def __init__(
        self,
        directory: Path,
        topics: Sequence[Topic],
        schemas: MessageSchemas,
        *,
        provenance: Mapping[str, Mapping[str, str]] | None = None,
        flush_interval_s: float = FLUSH_INTERVAL_S,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.directory = directory
        self.path = directory / f"{directory.name}_0.mcap"
        self.counts: Counter[str] = Counter()
        self._published_ns: Counter[str] = Counter()
        self._flush_interval_s = flush_interval_s
        self._clock_s = clock_s
        self._start_ns = 0
        self._end_ns = 0
        self._failure: BagWriteError | None = None
        self._closed = False
        definitions = {topic.type: schemas.schema(topic.type) for topic in topics}
        self._reserve, self._stream = self._create()
        try:
            self._writer = McapWriter(self._stream, f"feedopt_recorder {package_version()}")
            for name, values in (provenance or {}).items():
                self._writer.add_metadata(name, dict(values))
        except OSError as error:
            raise self._fail(error) from error
        schema_ids = {name: self._writer.add_schema(name, text) for name, text in definitions.items()}
        self._entries = {topic.name: _entry(topic, schemas) for topic in topics}
        self._channels = {topic.name: self._register(topic, schema_ids) for topic in topics}
        self._next_flush_s = clock_s() + flush_interval_s

    def write(self, messages: Iterable[Received]) -> None:
        """Add messages, in order of their log times; publish times are written as no earlier than those before.

        Raises:
            BagWriteError: disk full or folder gone; the file was closed with everything up to the last whole chunk.
        """
        self._check_open()
        add, channels, published_ns, counts = self._writer.add_message, self._channels, self._published_ns, self.counts
        log_ns = self._end_ns
        try:
            for log_ns, sent_ns, topic, payload, number in messages:
                # Several publishers of one topic are heard in another order than they spoke; viewers need both time
                # lines to run forward. The stamps inside the messages stay as they are.
                publish_ns = published_ns[topic] = max(sent_ns, published_ns[topic])
                self._start_ns = self._start_ns or log_ns
                counts[topic] += 1
                add(channels[topic], payload, log_ns, publish_ns, number & 0xFFFFFFFF)
        except OSError as error:
            raise self._fail(error) from error
        self._end_ns = max(self._end_ns, log_ns)

    def flush_if_due(self) -> None:
        """Close the chunk in progress when the flush interval is over. Raises BagWriteError."""
        now_s = self._clock_s()
        if now_s < self._next_flush_s:
            return
        self._next_flush_s = now_s + self._flush_interval_s
        self._check_open()
        try:
            self._writer.close_chunk()
        except OSError as error:
            raise self._fail(error) from error

    def close(self, closing_metadata: Mapping[str, Mapping[str, str]] | None = None) -> BagEntry:
        """Write the index and ``metadata.yaml``, and close the file.

        Args:
            closing_metadata: MCAP metadata records known only now, such as the recorder's summary.

        Raises:
            BagWriteError: disk full, or the bag failed before; it stands repaired as far as that was possible.
        """
        self._check_open()
        bag = BagEntry(self.path.name, self._start_ns, self._end_ns, self._topic_entries())
        try:
            self._writer.close_chunk()
            for name, values in (closing_metadata or {}).items():
                self._writer.add_metadata(name, dict(values))
            information = yaml.safe_dump(bag_information(bag), sort_keys=False)
            self._writer.add_metadata("rosbag2", {"serialized_metadata": information})
            self._writer.finish()
            os.fsync(self._stream.fileno())
            self._stream.close()
            self._reserve.close()
            write_metadata(self.directory, bag)
        except OSError as error:
            raise self._fail(error) from error
        self._closed = True
        return bag

    def _create(self) -> tuple[IO[bytes], _UnbufferedFile]:
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            if any(self.directory.iterdir()):
                raise BagWriteError(f"{self.directory}: is not empty; give a folder that does not exist yet")
            # Unlinked at once: the space comes back on close, and also when this process is killed.
            reserve = tempfile.TemporaryFile(dir=self.directory, buffering=0)  # noqa: SIM115 - held while recording
            os.posix_fallocate(reserve.fileno(), 0, RESERVE_BYTES)
            return reserve, _UnbufferedFile(self.path)
        except OSError as error:
            raise BagWriteError(
                f"{self.directory}: cannot create a bag: {error.strerror}; choose another folder or free disk space"
            ) from error

    def _register(self, topic: Topic, schema_ids: Mapping[str, int]) -> int:
        entry = self._entries[topic.name]
        metadata = {"offered_qos_profiles": entry.offered_qos_profiles, "topic_type_hash": entry.type_hash}
        return self._writer.add_channel(topic.name, schema_ids[topic.type], metadata)

    def _topic_entries(self) -> tuple[TopicEntry, ...]:
        return tuple(
            TopicEntry(name, entry.type_name, entry.type_hash, entry.offered_qos_profiles, self.counts[name])
            for name, entry in self._entries.items()
        )

    def _check_open(self) -> None:
        if self._failure is not None:
            raise self._failure
        if self._closed:
            raise BagWriteError(f"{self.path}: the bag is closed")

    def _fail(self, error: OSError) -> BagWriteError:
        """Save what can be saved and say how much that is."""
        written = sum(self.counts.values())
        with suppress(OSError):
            self._reserve.close()
            self._stream.close()
        try:
            saved = sum(topic.message_count for topic in repair_bag(self.directory).topics)
            outcome = f"{saved} of {written} messages are saved and readable"
        except (OSError, BagError) as further:
            outcome = f"its index could not be written ({further}); repair the bag after freeing disk space"
        self._failure = BagWriteError(f"{self.path}: {error.strerror or error}; {outcome}")
        return self._failure


def _entry(topic: Topic, schemas: MessageSchemas) -> TopicEntry:
    return TopicEntry(topic.name, topic.type, schemas.type_hash(topic.type), qos_profiles_yaml([topic.qos]), 0)


class _UnbufferedFile:
    """A file whose bytes are with the operating system once they are written, all of them, or the write raises."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("xb", buffering=0)

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            view = view[self._file.write(view) :]
        return len(data)

    def tell(self) -> int:
        return self._file.tell()

    def fileno(self) -> int:
        return self._file.fileno()

    def close(self) -> None:
        self._file.close()
