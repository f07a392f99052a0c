"""A signal shuts ROS down while threads of a node still work: that is an end, not a failure."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy

from feedopt_msgs.msg import NodeStatus
from feedopt_node.graph_node import GraphNode
from feedopt_node.parameters import GraphParameters
from feedopt_node.polling import PollingThread


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
