"""A signal shuts ROS down while threads of a node still work: that is an end, not a failure."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy

from feedopt_msgs.msg import NodeStatus
from feedopt_node.graph_node import GraphNode
from feedopt_node.parameters import GraphParameters
from feedopt_node.polling import PollingThread

# ROS shut down without a wake-up, as an executor sees it that looked between the two steps of rclpy's signal handling.
ENDS_UNSEEN = """
import threading, time
from feedopt_node.graph_node import GraphNode
from feedopt_node.parameters import GraphParameters
from feedopt_node.run import run_node

def end(context):
    time.sleep(1.0)  # the executor waits by then; should it not, the test is easier than meant, and still true
    with context.handle:
        context.handle.shutdown()

def make():
    node = GraphNode("recorder", GraphParameters, polled=True)
    threading.Thread(target=end, args=(node.context,), daemon=True).start()
    return node

raise SystemExit(run_node(make, arguments=["test", "--ros-args", "-p", "present_nodes:=[recorder]"]))
"""


@pytest.fixture
def node() -> Iterator[GraphNode[Any]]:
    rclpy.init(args=["test", "--ros-args", "-p", "present_nodes:=[toolpath]"])
    node = GraphNode("toolpath", GraphParameters)
    yield node
    node.destroy_node()
    rclpy.try_shutdown()


def test_a_report_after_the_end_is_no_failure(node: GraphNode[Any]) -> None:
    rclpy.shutdown()
    node.life.report(state=NodeStatus.FAULT, text="nobody hears it")


def test_polling_ends_with_ros_and_reports_what_is_wrong_before(node: GraphNode[Any]) -> None:
    failures: list[Exception] = []
    polled = threading.Event()

    def poll_after_the_end() -> None:
        polled.set()
        publisher.publish(NodeStatus())

    publisher = node.create_publisher(NodeStatus, "ended", 1)
    rclpy.shutdown()
    thread = PollingThread("test", 0.001, poll_after_the_end, failures.append)
    thread.start()
    assert polled.wait(30.0)
    thread.close()
    assert failures == []

    broken = threading.Event()

    def poll_broken() -> None:
        broken.set()
        raise ValueError("a real failure")

    thread = PollingThread("test", 0.001, poll_broken, failures.append)
    thread.start()
    assert broken.wait(30.0)
    thread.close()
    assert [str(failure) for failure in failures] == ["a real failure"]


def test_a_node_with_nothing_to_wake_up_for_sees_the_end() -> None:
    assert subprocess.run([sys.executable, "-c", ENDS_UNSEEN], timeout=60.0, check=False).returncode == 0
