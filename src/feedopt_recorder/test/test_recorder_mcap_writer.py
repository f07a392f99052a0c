"""The file that the recorder writes, record by record, as the mcap package reads it."""

from __future__ import annotations

import io
import zlib
from collections import defaultdict

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import ReadDataStream
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Footer, Message, MessageIndex, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream

from feedopt_recorder import mcap_writer
from feedopt_recorder.mcap_writer import McapWriter

Row = tuple[int, bytes, int]
ROWS = st.lists(st.tuples(st.integers(1, 3), st.binary(max_size=200), st.integers(0, 2**62)), min_size=1, max_size=60)


def written(rows: list[Row], close_after: set[int] = frozenset()) -> bytes:  # type: ignore[assignment]
    stream = io.BytesIO()
    writer = McapWriter(stream, "test")
    writer.add_metadata("feedopt/test", {"key": "value"})
    schema = writer.add_schema("builtin_interfaces/msg/Time", "int32 sec\nuint32 nanosec\n")
    for number in range(1, 4):
        assert writer.add_channel(f"/topic_{number}", schema, {"topic_type_hash": "RIHS01_0"}) == number
    for index, (channel, payload, log_ns) in enumerate(rows):
        writer.add_message(channel, payload, log_ns, log_ns + 1, index)
        if index in close_after:
            writer.close_chunk()
    writer.finish()
    return stream.getvalue()


@settings(deadline=None)
@given(rows=ROWS, close_after=st.sets(st.integers(0, 59)))
def test_everything_is_read_back(rows: list[Row], close_after: set[int]) -> None:
    data = written(rows, close_after)
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    found = [
        (message.channel_id, bytes(message.data), message.log_time, message.publish_time, message.sequence)
        for _, _, message in reader.iter_messages(log_time_order=False)
    ]
    assert found == [(channel, payload, log_ns, log_ns + 1, i) for i, (channel, payload, log_ns) in enumerate(rows)]
    summary = reader.get_summary()
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == len(rows)
    assert summary.statistics.message_start_time == min(log_ns for _, _, log_ns in rows)
    assert summary.statistics.message_end_time == max(log_ns for _, _, log_ns in rows)
    assert [record.name for record in reader.iter_metadata()] == ["feedopt/test"]


@settings(deadline=None)
@given(rows=ROWS, close_after=st.sets(st.integers(0, 59)))
def test_indexes_point_at_their_messages(rows: list[Row], close_after: set[int]) -> None:
    data = written(rows, close_after)
    reader = make_reader(io.BytesIO(data))
    summary = reader.get_summary()
    assert summary is not None
    indexed = 0
    for chunk_index in summary.chunk_indexes:
        records = StreamReader(io.BytesIO(data[chunk_index.chunk_start_offset :]), skip_magic=True, emit_chunks=True)
        chunk = next(iter(records.records))
        assert isinstance(chunk, Chunk)
        content = get_chunk_data_stream(chunk, validate_crc=True)[0].read(chunk.uncompressed_size)
        for channel, offset in chunk_index.message_index_offsets.items():
            index = MessageIndex.read(ReadDataStream(io.BytesIO(data[offset + 9 :])))
            assert index.channel_id == channel
            for log_ns, place in index.records:
                length = int.from_bytes(content[place + 1 : place + 9], "little")
                message = Message.read(ReadDataStream(io.BytesIO(content[place + 9 :])), length)
                assert (message.channel_id, message.log_time) == (channel, log_ns)
                indexed += 1
    assert indexed == len(rows)


def test_first_chunk_declares_schemas_and_channels() -> None:
    data = written([(1, b"a", 1), (2, b"b", 2), (1, b"c", 3)], {0})
    kinds: defaultdict[type, int] = defaultdict(int)
    for record in StreamReader(io.BytesIO(data)).records:
        if isinstance(record, Message):
            break
        kinds[type(record)] += 1
    assert (kinds[Schema], kinds[Channel]) == (1, 3)


def test_full_chunk_is_written_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_writer, "CHUNK_BYTES", 1000)
    stream = io.BytesIO()
    writer = McapWriter(stream, "test")
    channel = writer.add_channel("/topic", writer.add_schema("a/msg/B", ""), {})
    before = stream.tell()
    for number in range(4):
        writer.add_message(channel, bytes(249), number, number, number)
    assert stream.tell() == before
    writer.add_message(channel, bytes(249), 4, 4, 4)
    assert stream.tell() > before


def test_footer_covers_the_summary_with_its_checksum() -> None:
    data = written([(1, b"a", 1)])
    footer = next(record for record in StreamReader(io.BytesIO(data)).records if isinstance(record, Footer))
    assert zlib.crc32(data[footer.summary_start : -12]) == footer.summary_crc
