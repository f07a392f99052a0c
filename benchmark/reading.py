"""Time to read a long bag into numpy, and comparison with the values that rosbags reads.

Run: ``./feedopt bench reading [--messages N] [--checked N]``. A bag of set points and axis states of three axes is
written and read with ``read_messages`` and ``columns``. ``--checked`` messages of each topic are compared with those
read by rosbags, field by field.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from feedopt_node.graph import load_graph
from feedopt_recorder.bag_writer import BagWriter, Received
from feedopt_recorder.bags.messages import TopicMessages, read_messages
from feedopt_recorder.message_schemas import MessageSchemas, ament_share_directories

TOPICS = ("/axis_setpoint", "/axis_state")
START_NS = 1_760_000_000_000_000_000
_BATCH = 1000
_AXES = 3


def main(argv: list[str]) -> int:
    """Command line; returns the exit code: 0 if rosbags reads the same values, else 1."""
    parser = argparse.ArgumentParser(prog="feedopt bench reading", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--messages", type=int, default=1_200_000, help="messages of the bag, both topics together")
    parser.add_argument("--checked", type=int, default=20_000, help="messages of each topic compared with rosbags")
    arguments = parser.parse_args(argv)
    with tempfile.TemporaryDirectory(prefix="feedopt-reading-") as folder:
        bag = Path(folder) / "long"
        began_s = time.perf_counter()
        write_bag(bag, arguments.messages // len(TOPICS))
        wrote_s = time.perf_counter() - began_s
        began_s, began_cpu_s = time.perf_counter(), time.process_time()
        contents = read_messages(bag)
        columns = {name: contents.topics[name].columns() for name in TOPICS}
        read_s, read_cpu_s = time.perf_counter() - began_s, time.process_time() - began_cpu_s
        differing = sum(differences(bag, contents.topics[name], columns[name], arguments.checked) for name in TOPICS)
        size = (bag / "long_0.mcap").stat().st_size
    count = sum(len(contents.topics[name]) for name in TOPICS)
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    table.add_row("bag", f"{count} messages, {size / 1e6:.0f} MB, written in {wrote_s:.1f} s")
    table.add_row("read into numpy", f"{read_s:.2f} s ({read_cpu_s:.2f} s of processor time)")
    table.add_row("compared with rosbags", f"{min(arguments.checked, count)} of each topic, {differing} fields differ")
    table.add_row("load", f"{os.getloadavg()[0]:.2f}")
    Console().print(table)
    return 1 if differing else 0


def write_bag(bag: Path, rows: int) -> None:
    """Write a bag with ``rows`` messages on each topic, one per millisecond."""
    schemas = MessageSchemas(ament_share_directories())
    store = get_typestore(Stores.ROS2_JAZZY)
    topics = [topic for topic in load_graph().topics.values() if topic.name in TOPICS]
    for topic in topics:
        store.register(get_types_from_msg(schemas.schema(topic.type), topic.type))
    payloads = {topic.name: _serialised(store, topic.type) for topic in topics}
    writer = BagWriter(bag, topics, schemas)
    for first in range(0, rows, _BATCH):
        batch = []
        for row, topic in itertools.product(range(first, min(first + _BATCH, rows)), topics):
            payload = payloads[topic.name]
            # The sequence number, after CDR header, stamp, program and padding.
            payload[20:28] = (row + 1).to_bytes(8, "little")
            time_ns = START_NS + row * 1_000_000
            batch.append(Received(time_ns, time_ns, topic.name, bytes(payload), row + 1))
        writer.write(batch)
    writer.close()


def _serialised(store: Typestore, type_name: str) -> bytearray:
    values: dict[str, Any] = {}
    for name, (node, detail) in store.get_msgdef(type_name).fields:
        if name == "stamp":
            values[name] = store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
        elif node.name == "SEQUENCE":
            values[name] = np.arange(_AXES).astype(detail[0][1][0])
        else:
            values[name] = 1
    return bytearray(store.serialize_cdr(store.types[type_name](**values), type_name))


def differences(bag: Path, topic: TopicMessages, columns: dict[str, Any], count: int) -> int:
    """Number of fields in which the first messages of a topic differ from what rosbags reads."""
    differing = 0
    for row, message in enumerate(itertools.islice(_rosbags_messages(bag, topic.name), count)):
        for name, column in columns.items():
            value: Any = message
            for part in name.split("."):
                value = getattr(value, part)
            differing += not np.array_equal(np.asarray(value), column[row])
    return differing


def _rosbags_messages(bag: Path, topic: str) -> Iterator[Any]:
    with AnyReader([bag]) as reader:
        connections = [connection for connection in reader.connections if connection.topic == topic]
        for connection, _, payload in reader.messages(connections):
            yield reader.deserialize(payload, connection.msgtype)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
