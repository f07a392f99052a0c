"""Reading a bag at chunk level, against rosbags field by field, and every way a bag can be bad."""

from __future__ import annotations

import struct
import tempfile
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import Writer
from recorded_run import MACHINE_YAML, REST_TICKS, TOPICS, messages, motion, schemas, typestore, write_run
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from feedopt_node.graph import Qos, Topic
from feedopt_recorder.bag_writer import BagWriter, Received
from feedopt_recorder.bags.cdr_layout import NoFixedLayoutError, layout_of
from feedopt_recorder.bags.messages import read_messages
from feedopt_recorder.bags.read_bag import read_bag
from feedopt_recorder.bags.repair import repair_bag
from feedopt_recorder.errors import (
    BagEmptyError,
    BagError,
    BagForeignError,
    BagMissingError,
    BagTruncatedError,
)

DURATION_S = 0.6


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bags")
    return write_run(folder / "run", folder / "share", duration_s=DURATION_S)


def by_rosbags(bag: Path, topic: str) -> list[Any]:
    with AnyReader([bag]) as reader:
        connections = [connection for connection in reader.connections if connection.topic == topic]
        return [reader.deserialize(payload, c.msgtype) for c, _, payload in reader.messages(connections)]


@pytest.mark.parametrize(("topic", "name"), [("/axis_setpoint", "setpoints"), ("/axis_state", "states")])
def test_every_field_equals_what_rosbags_reads(bag: Path, topic: str, name: str) -> None:
    samples = getattr(read_bag(bag), name)
    expected = by_rosbags(bag, topic)
    assert len(samples) == len(expected) == round(DURATION_S * 1000) + 2 * REST_TICKS + 1
    compared = 0
    for field in fields(samples):
        if field.name in ("stamp_ns", "received_ns", "period_s"):
            continue
        np.testing.assert_array_equal(
            getattr(samples, field.name), np.array([getattr(m, field.name) for m in expected])
        )
        compared += 1
    assert compared == len(fields(samples)) - 3
    assert samples.period_s == 0.001
    stamps = [m.stamp.sec * 10**9 + m.stamp.nanosec for m in expected]
    np.testing.assert_array_equal(samples.stamp_ns, stamps)


def test_domain_objects_come_back(bag: Path) -> None:
    run, expected = read_bag(bag), motion(DURATION_S)
    np.testing.assert_array_equal(run.setpoints.position_mm, expected.position_mm)
    np.testing.assert_array_equal(run.states.tracking_error_mm, expected.tracking_error_mm)
    assert run.machine is not None
    assert run.machine.axis_names == ("X", "Y")
    assert run.machine.jerk_limit_mm_s3 == (63000.0, 156000.0)
    assert run.machine.yaml_text == MACHINE_YAML
    assert run.machine.tracking is not None
    assert run.machine.tracking.tracking_kj_s3 == (5.2e-8, 1.8e-8)
    assert [segment.place.sequence for segment in run.segments] == list(range(1, len(run.segments) + 1))
    assert run.segments[-1].place.last
    end = run.segments[-1].evaluate(np.array([run.segments[-1].length_mm])).r_mm[0]
    np.testing.assert_allclose(end, expected.position_mm[-1], atol=1e-9)
    assert [chunk.sequence for chunk in run.chunks] == [1, 2, 3, 4, 5, 6]
    assert run.chunks[2].figures.iterations == 14
    assert run.chunks[0].certificate.worst_axis == "X"
    assert {status.node for status in run.statuses} >= {"toolpath", "planner", "interpolator", "router_sim"}
    assert run.title == "eight.nc"
    assert run.program_ids == (1,)
    assert run.motion_time_s == pytest.approx(DURATION_S, abs=0.03)


def test_each_program_is_read_on_its_own(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", TOPICS, schemas(tmp_path / "share"))
    for program_id in (1, 2):
        for message in messages(0.2):
            payload = bytearray(message.payload)
            if message.topic in ("/axis_setpoint", "/axis_state", "/toolpath", "/feed_profile"):
                payload[12:16] = struct.pack("<I", program_id)
            time_ns = message.time_ns + program_id * 10**10
            writer.write([Received(time_ns, time_ns, message.topic, bytes(payload), 0)])
    writer.close()
    last, first = read_bag(tmp_path / "run"), read_bag(tmp_path / "run", 1)
    assert (last.program_id, first.program_id) == (2, 1)
    assert last.program_ids == (1, 2)
    assert len(last.setpoints) == len(first.setpoints) == 301
    assert set(first.states.program_id) == {1}
    assert first.states.received_ns[0] < last.states.received_ns[0]
    with pytest.raises(BagEmptyError, match="no program 3; it holds 1, 2"):
        read_bag(tmp_path / "run", 3)


def test_missing_bags(tmp_path: Path) -> None:
    with pytest.raises(BagMissingError, match="no such bag"):
        read_bag(tmp_path / "nothing")
    with pytest.raises(BagMissingError, match="no MCAP file"):
        read_bag(tmp_path)


def test_empty_bags(tmp_path: Path) -> None:
    (tmp_path / "empty.mcap").write_bytes(b"")
    with pytest.raises(BagEmptyError, match="file is empty"):
        read_bag(tmp_path / "empty.mcap")
    BagWriter(tmp_path / "silent", TOPICS, schemas(tmp_path / "share")).close()
    with pytest.raises(BagEmptyError, match="no message"):
        read_bag(tmp_path / "silent")


def test_foreign_bags(tmp_path: Path) -> None:
    (tmp_path / "photo.mcap").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    with pytest.raises(BagForeignError, match="not an MCAP file"):
        read_bag(tmp_path / "photo.mcap")
    json_bag = tmp_path / "json.mcap"
    with json_bag.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/status", "json", writer.register_schema("Any", "jsonschema", b"{}"))
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(BagForeignError, match=r"/status is json with jsonschema"):
        read_bag(json_bag)
    other = (Topic("/chatter", "builtin_interfaces/msg/Time", (), (), Qos("any", "reliable", "volatile", 1)),)
    writer = BagWriter(tmp_path / "chat", other, schemas(tmp_path / "share"))
    writer.write([Received(1, 1, "/chatter", bytes([0, 1, 0, 0]) + bytes(8), 0)])
    writer.close()
    with pytest.raises(BagForeignError, match="none of the topics"):
        read_bag(tmp_path / "chat")


def test_topic_of_another_type_is_foreign(tmp_path: Path) -> None:
    other = (Topic("/axis_state", "builtin_interfaces/msg/Time", (), (), Qos("any", "reliable", "volatile", 1)),)
    writer = BagWriter(tmp_path / "old", other, schemas(tmp_path / "share"))
    writer.write([Received(1, 1, "/axis_state", bytes([0, 1, 0, 0]) + bytes(8), 0)])
    writer.close()
    with pytest.raises(BagForeignError, match=r"/axis_state is builtin_interfaces/msg/Time"):
        read_bag(tmp_path / "old")


@pytest.mark.parametrize("part", [0.05, 0.3, 0.9, 0.999])
def test_cut_off_bag_is_named_and_can_be_mended(bag: Path, tmp_path: Path, part: float) -> None:
    whole = (bag / "run_0.mcap").read_bytes()
    cut = tmp_path / "cut"
    cut.mkdir()
    (cut / "cut_0.mcap").write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(BagTruncatedError, match=r"feedopt bag recover"):
        read_bag(cut)
    count = sum(topic.message_count for topic in repair_bag(cut).topics)
    if count == 0:
        assert part < 0.5
        return
    contents = read_messages(cut)
    assert sum(len(topic) for topic in contents.topics.values()) == count
    assert contents.complete


def test_damaged_chunk_is_found_by_its_checksum(bag: Path, tmp_path: Path) -> None:
    data = bytearray((bag / "run_0.mcap").read_bytes())
    data[len(data) // 3] ^= 0xFF
    path = tmp_path / "damaged.mcap"
    path.write_bytes(bytes(data))
    with pytest.raises(BagTruncatedError, match="damaged chunk"):
        read_bag(path)


def test_number_of_axes_must_not_change(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "run", TOPICS, schemas(tmp_path / "share"))
    for message in messages(0.1):
        # The 50th set point is one number longer.
        longer = message.topic == "/axis_setpoint" and writer.counts["/axis_setpoint"] == 49
        payload = message.payload + bytes(8 * longer)
        writer.write([replace(message, payload=payload).received()])
    writer.close()
    with pytest.raises(BagForeignError, match=r"/axis_setpoint: messages of 2 different sizes"):
        read_bag(tmp_path / "run")


@given(st.binary(max_size=400))
def test_arbitrary_bytes_never_escape_the_typed_errors(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.mcap"
        path.write_bytes(b"\x89MCAP0\r\n" + data)
        with pytest.raises(BagError):
            read_bag(path)


TYPES = get_types_from_msg(
    "bool a\nint16 b\nfloat64[] c\nuint8[3] d\nfloat32 e\nint64[] f\nbool[] g\nuint16 h\n", "t/msg/T"
)


@given(
    st.lists(st.floats(allow_nan=False), max_size=4),
    st.lists(st.integers(-(2**63), 2**63 - 1), max_size=3),
    st.lists(st.booleans(), max_size=5),
)
def test_layout_agrees_with_rosbags_on_any_lengths(c: list[float], f: list[int], g: list[bool]) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(TYPES)
    message = store.types["t/msg/T"](
        a=True,
        b=-5,
        c=np.array(c, float),
        d=np.array([1, 2, 3], np.uint8),
        e=0.5,
        f=np.array(f, np.int64),
        g=np.array(g, bool),
        h=77,
    )
    payload = bytes(store.serialize_cdr(message, "t/msg/T"))
    row = np.frombuffer(payload, layout_of(TYPES, "t/msg/T", payload).dtype(len(payload)))[0]
    assert (row["a"], row["b"], row["e"], row["h"]) == (True, -5, 0.5, 77)
    for name, values in (("c", c), ("f", f), ("g", g)):
        assert row["#" + name] == len(values)
        if values:
            np.testing.assert_array_equal(row[name], values)
    with pytest.raises(NoFixedLayoutError):
        layout_of(TYPES, "t/msg/T", payload + bytes(8))


def test_messages_with_strings_go_the_general_way(bag: Path) -> None:
    contents = read_messages(bag, ("/status", "/machine"))
    with pytest.raises(BagForeignError, match="string"):
        contents.topics["/machine"].columns()
    assert len(contents.topics["/status"].objects()) == len(by_rosbags(bag, "/status"))
    assert "feedopt_msgs/msg/NodeStatus" in typestore().types
