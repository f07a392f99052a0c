"""Failures as fields of the action's result: toolpath node, planner node and client in one process."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.action import ActionClient
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

from feedopt_core.errors import Failure, FailureKind, InfeasibleLimitsError
from feedopt_core.planner.stream_planner import StreamPlanner
from feedopt_msgs.action import ExecuteProgram
from feedopt_msgs.msg import NodeStatus
from feedopt_node.failure_conversions import failure_from_message
from feedopt_node.graph_node import GraphNode
from feedopt_node.parameters import MachineNodeParameters
from feedopt_node.status import STATUS_TOPIC
from feedopt_planner.planner_node import PlannerNode
from feedopt_planner.toolpath_node import ACTION, ToolpathNode

PATIENCE_S = 60.0
ARGUMENTS = [
    "test",
    "--ros-args",
    "-p",
    "machine:=router_simulation",
    "-p",
    "present_nodes:=[toolpath,planner,interpolator]",
]
GOOD = "G21 G90 F600\nG1 X10\nG1 Y5\nM2\n"


class StandingInterpolator(GraphNode[MachineNodeParameters]):
    """Never moves: whatever fails, the machine stands still already."""

    def __init__(self) -> None:
        super().__init__("interpolator", MachineNodeParameters)
        for topic in self.graph.publications("interpolator"):
            if topic.name != STATUS_TOPIC:
                self.publish_topic(topic.name)
        for topic in self.graph.subscriptions("interpolator"):
            if topic.name != STATUS_TOPIC:
                self.subscribe_topic(topic.name, lambda _: None)
        self.life.on_peer(self._take_status)

    def _take_status(self, status: NodeStatus) -> None:
        if status.state == NodeStatus.FAULT:
            self.life.report(state=NodeStatus.DONE, program_id=status.program_id)


class Client:
    """Sends programs and waits for their results."""

    def __init__(self, node: Node) -> None:
        self._action = ActionClient(node, ExecuteProgram, ACTION)

    def execute(self, text: str) -> ExecuteProgram.Result:
        assert self._action.wait_for_server(timeout_sec=PATIENCE_S)
        goal = _result(self._action.send_goal_async(ExecuteProgram.Goal(text=text, name="pocket.ngc")))
        assert goal.accepted
        return _result(goal.get_result_async()).result


def _result(future: Any) -> Any:
    """Result of a future that the executor of another thread completes."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    assert done.wait(PATIENCE_S)
    return future.result()


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    rclpy.init(args=ARGUMENTS)
    graph = [ToolpathNode(), PlannerNode(), StandingInterpolator()]
    nodes: list[Node] = [*graph, rclpy.create_node("client", use_global_arguments=False)]
    executor = MultiThreadedExecutor(num_threads=5)
    for node in nodes:
        executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    yield Client(nodes[-1])
    executor.shutdown()
    thread.join()
    for member in graph:
        member.close()
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


def raising(error: Exception) -> Callable[[StreamPlanner], None]:
    def next_chunk(planner: StreamPlanner) -> None:
        raise error

    return next_chunk


def test_a_program_error_has_its_place(client: Client) -> None:
    result = client.execute("G21 G90 F600\nG1 X10\nG1 X2-0\n")
    failure = failure_from_message(result.failure)
    assert failure is not None
    assert (failure.kind, failure.node) == (FailureKind.PROGRAM, "toolpath")
    assert (failure.source, failure.line) == ("pocket.ngc", 3)
    assert failure.column == "G1 X2-0".index("-") + 1
    assert "pocket.ngc" not in failure.message


def test_a_limit_that_no_motion_keeps_is_named(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    error = InfeasibleLimitsError("lower it", quantity="jerk", axis="Y", s_mm=2.5, ratio=1.25)
    monkeypatch.setattr(StreamPlanner, "next_chunk", raising(error))
    failure = failure_from_message(client.execute(GOOD).failure)
    assert failure == Failure(
        kind=FailureKind.INFEASIBLE,
        message="lower it",
        node="planner",
        axis="Y",
        quantity="jerk",
        s_mm=2.5,
        ratio=1.25,
    )


def test_an_exception_of_a_node_is_internal(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StreamPlanner, "next_chunk", raising(ZeroDivisionError("by zero")))
    failure = failure_from_message(client.execute(GOOD).failure)
    assert failure == Failure(kind=FailureKind.INTERNAL, message="ZeroDivisionError: by zero", node="planner")
