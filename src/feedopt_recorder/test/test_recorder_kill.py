"""A recorder that is killed: what had left it is there, without a gap, and the bag is readable again."""

from __future__ import annotations

import itertools
import os
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rosbags.highlevel import AnyReader

pytest.importorskip("rclpy")
pytest.importorskip("feedopt_msgs.msg")

import rclpy

from feedopt_msgs.msg import AxisSetpoint
from feedopt_node.graph import load_graph
from feedopt_node.qos import qos_profile
from feedopt_recorder.bags.check_bag import check_bag
from feedopt_recorder.bags.repair import repair_bag

pytestmark = pytest.mark.graph

DEADLINE_S = 60.0
TOPIC = "/axis_setpoint"
BURST = 100
TESTS = itertools.count()


@pytest.fixture
def publisher(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    # A domain a test: what an earlier one leaves behind must not be heard.
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + (os.getpid() + 45 + next(TESTS)) % 90))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init(args=[])
    node = rclpy.create_node("interpolator", enable_rosout=False)
    yield node.create_publisher(AxisSetpoint, TOPIC, qos_profile(load_graph().topics[TOPIC].qos))
    node.destroy_node()
    rclpy.try_shutdown()


@pytest.mark.parametrize("seed", range(4))
def test_killed_recorder_leaves_a_readable_bag_without_gaps(tmp_path: Path, publisher: Any, seed: int) -> None:
    bag = tmp_path / "run"
    command = [sys.executable, "-m", "feedopt_recorder.recorder_node", "--ros-args"]
    command += ["-p", "present_nodes:=[recorder]", "-p", f"bag_directory:={bag}"]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        while publisher.get_subscription_count() == 0:
            assert process.poll() is None
        # The instant is one of the bytes that the file has: wherever that falls in the recorder's work.
        size = random.Random(seed).randrange(20_000, 60_000)
        sent = publish_until(publisher, bag / "run_0.mcap", size)
    finally:
        process.kill()
        process.wait(DEADLINE_S)
    repair_bag(bag)
    with AnyReader([bag]) as reader:
        connections = [connection for connection in reader.connections if connection.topic == TOPIC]
        sequences = [
            reader.deserialize(payload, connection.msgtype).sequence  # type: ignore[attr-defined]
            for connection, _, payload in reader.messages(connections)
        ]
    assert sequences == list(range(1, len(sequences) + 1))
    assert 0 < len(sequences) <= sent
    assert {finding.kind for finding in check_bag(bag)} <= {"end_missing"}


def publish_until(publisher: Any, path: Path, size: int) -> int:
    """Publish set points until the bag has grown to that size; returns their number."""
    message = AxisSetpoint(program_id=1)
    for sequence in itertools.count(1):
        message.sequence, message.tick = sequence, sequence - 1
        # Numbers that do not compress, so that the file grows steadily.
        message.position_mm = [random.random() for _ in range(20)]
        publisher.publish(message)
        if sequence % BURST == 0:
            assert publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=DEADLINE_S))
        if path.stat().st_size >= size:
            return sequence
    raise AssertionError("never reached")
