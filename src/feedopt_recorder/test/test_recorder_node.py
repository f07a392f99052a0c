"""The recorder as a process beside real publishers."""

from __future__ import annotations

import itertools
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rosbags.highlevel import AnyReader

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("feedopt_msgs.msg")

pytestmark = pytest.mark.graph

DEADLINE_S = 60.0
COUNT = 800
TESTS = itertools.count()
PRESENT = ["interpolator", "router_sim", "recorder"]


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    # A domain a test: what an earlier one leaves behind must not be heard.
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + (os.getpid() + next(TESTS)) % 90))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init(args=["test", "--ros-args", "-p", f"present_nodes:=[{', '.join(PRESENT)}]"])
    yield
    rclpy.try_shutdown()


class Peers:
    """Interpolator and simulated router: they publish what they are told, and nothing else."""

    def __init__(self) -> None:
        from feedopt_node.graph_node import GraphNode
        from feedopt_node.parameters import GraphParameters

        self.publishers: dict[str, Any] = {}
        self.ready = threading.Event()
        self.nodes = [GraphNode(name, GraphParameters) for name in PRESENT[:2]]
        self.executor = rclpy.executors.SingleThreadedExecutor()
        for node in self.nodes:
            for topic in node.graph.publications(node.get_name()):
                if topic.name != "/status":
                    self.publishers[topic.name] = node.publish_topic(topic.name)
            for topic in node.graph.subscriptions(node.get_name()):
                if topic.name != "/status":
                    node.subscribe_topic(topic.name, lambda _: None, raw=True)
            self.executor.add_node(node)
            node.create_timer(0.02, self._look)
        self.thread = threading.Thread(target=self._spin, daemon=True)
        self.thread.start()

    def close(self) -> None:
        self.executor.shutdown()
        self.thread.join()
        for node in self.nodes:
            node.destroy_node()

    def _look(self) -> None:
        if all(node.life.peers_ready() is None for node in self.nodes):
            self.ready.set()

    def _spin(self) -> None:
        try:
            self.executor.spin()
        except (rclpy.executors.ExternalShutdownException, rclpy.executors.ShutdownException):
            return


def start_recorder(bag: Path, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "feedopt_recorder.recorder_node", "--ros-args"]
    command += ["-p", f"present_nodes:=[{', '.join(PRESENT)}]", "-p", f"bag_directory:={bag}", *arguments]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True)


def record(bag: Path, publish: Callable[[Peers], None], stop: signal.Signals, *arguments: str) -> tuple[int, str]:
    process = start_recorder(bag, *arguments)
    peers = Peers()
    try:
        assert peers.ready.wait(DEADLINE_S), "the graph did not become ready"
        publish(peers)
        for publisher in peers.publishers.values():
            assert publisher.wait_for_all_acked(rclpy.duration.Duration(seconds=DEADLINE_S))
        process.send_signal(stop)
        _, errors = process.communicate(timeout=DEADLINE_S)
    finally:
        peers.close()
        process.kill()
        process.wait()
    return process.returncode, errors


def setpoint(sequence: int) -> Any:
    from feedopt_msgs.msg import AxisSetpoint

    message = AxisSetpoint(program_id=1, sequence=sequence, tick=sequence - 1, last=sequence == COUNT)
    message.position_mm = [0.001 * sequence, 2.0]
    return message


@pytest.mark.usefixtures("domain")
@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_everything_published_after_ready_is_in_the_bag(tmp_path: Path, stop: signal.Signals) -> None:
    bag = tmp_path / "run"
    provenance = tmp_path / "provenance.json"
    provenance.write_text(json.dumps({"feedopt/program": {"name": "eight.nc"}}))

    def publish(peers: Peers) -> None:
        for sequence in range(1, COUNT + 1):
            peers.publishers["/axis_setpoint"].publish(setpoint(sequence))

    code, errors = record(bag, publish, stop, "-p", f"provenance_file:={provenance}")
    assert code == 0, errors
    summary = json.loads((bag / "recorder_summary.json").read_text())
    assert summary["complete"]
    assert summary["topics"]["/axis_setpoint"]["programs"] == {"1": COUNT}
    assert summary["topics"]["/status"]["messages"] > 0
    with AnyReader([bag]) as reader:
        assert {connection.topic: connection.digest[:7] for connection in reader.connections} == dict.fromkeys(
            (connection.topic for connection in reader.connections), "RIHS01_"
        )
        rows = [
            (message.sequence, message.position_mm[0])
            for connection, _, payload in reader.messages(c for c in reader.connections if c.topic == "/axis_setpoint")
            for message in [reader.deserialize(payload, connection.msgtype)]
        ]
    assert rows == [(sequence, 0.001 * sequence) for sequence in range(1, COUNT + 1)]


@pytest.mark.usefixtures("domain")
def test_a_message_that_never_came_is_reported(tmp_path: Path) -> None:
    bag = tmp_path / "run"

    def publish(peers: Peers) -> None:
        for sequence in range(1, COUNT + 1):
            if sequence not in (1, 400, 401):
                peers.publishers["/axis_setpoint"].publish(setpoint(sequence))

    code, errors = record(bag, publish, signal.SIGTERM)
    assert code == 0, errors
    summary = json.loads((bag / "recorder_summary.json").read_text())
    assert not summary["complete"]
    assert [(gap["first"], gap["last"]) for gap in summary["gaps"]] == [(1, 1), (400, 401)]
    assert "400" in errors


def test_bag_that_exists_is_refused_at_once(tmp_path: Path) -> None:
    (tmp_path / "old").write_text("")
    process = start_recorder(tmp_path)
    _, errors = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 1
    assert "is not empty" in errors
    assert "Traceback" not in errors
