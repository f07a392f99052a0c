"""The simulated router alone, fed by hand: deterministic, and a lost set point is a fault it survives."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
from graph_run import MACHINE, wait_for
from rclpy.executors import SingleThreadedExecutor

from feedopt_core.errors import FailureKind
from feedopt_core.machine.machine_file import machine_path
from feedopt_msgs.msg import AxisSetpoint, AxisState, NodeStatus
from feedopt_node.failure_conversions import failure_of_status
from feedopt_node.graph import load_graph
from feedopt_node.qos import qos_profile
from feedopt_tools.execute.processes import GraphProcesses

pytestmark = pytest.mark.graph
TICKS = 300


class Bench:
    """Publishes set points and keeps states and statuses."""

    def __init__(self, context: rclpy.Context, processes: GraphProcesses) -> None:
        self.processes = processes
        self.states: list[AxisState] = []
        self.statuses: list[NodeStatus] = []
        topics = load_graph().topics
        self._node = rclpy.create_node("bench", context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)

        def subscribe(message_type: Any, topic: str, callback: Callable[[Any], None]) -> None:
            self._node.create_subscription(message_type, topic, callback, qos_profile(topics[topic].qos))

        subscribe(AxisState, "/axis_state", self.states.append)
        subscribe(NodeStatus, "/status", self.statuses.append)
        self._publisher = self._node.create_publisher(
            AxisSetpoint, "/axis_setpoint", qos_profile(topics["/axis_setpoint"].qos)
        )

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Take messages until a condition holds."""

        def holds() -> bool:
            self.processes.check()
            self._executor.spin_once(timeout_sec=0.02)
            return condition()

        wait_for(holds, what)

    def until_state(self, state: int, program_id: int) -> NodeStatus:
        """Wait for the router's report."""
        self.until(
            lambda: (
                bool(self.statuses) and (self.statuses[-1].state, self.statuses[-1].program_id) == (state, program_id)
            ),
            f"state {state} of program {program_id}",
        )
        return self.statuses[-1]

    def matched(self) -> bool:
        return self._publisher.get_subscription_count() == 1 and self._node.count_publishers("/axis_state") == 1

    def move(self, program_id: int, left_out: int = 0) -> None:
        """A smooth move of both axes; one set point may be left out."""
        u = np.clip(np.arange(TICKS) / (TICKS - 50), 0.0, 1.0)
        x = 5.0 * (10 * u**3 - 15 * u**4 + 6 * u**5)
        v = np.gradient(x, 0.001)
        a = np.gradient(v, 0.001)
        for i in range(TICKS):
            message = AxisSetpoint(program_id=program_id, sequence=i + 1, tick=i, last=i == TICKS - 1)
            message.position_mm = array("d", [x[i], -x[i]])
            message.velocity_mm_s = array("d", [v[i], -v[i]])
            message.acceleration_mm_s2 = array("d", [a[i], -a[i]])
            if i + 1 != left_out:
                self._publisher.publish(message)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    nodes = load_graph().processes(("router_sim",), str(machine_path(MACHINE)))
    processes = GraphProcesses(nodes, tmp_path_factory.mktemp("router_sim"))
    processes.start()
    context = rclpy.Context()
    rclpy.init(context=context)
    try:
        bench = Bench(context, processes)
        bench.until(lambda: bool(bench.statuses) and bench.matched(), "the router is there")
        yield bench
    finally:
        codes = processes.stop()
        rclpy.try_shutdown(context=context)
    assert codes == {"router_sim": 0}


def run(bench: Bench, program_id: int) -> list[AxisState]:
    bench.states.clear()
    bench.move(program_id)
    bench.until_state(NodeStatus.DONE, program_id)
    bench.until(lambda: len(bench.states) == TICKS, "every state")
    return list(bench.states)


def test_one_state_for_each_set_point_and_the_same_every_time(bench: Bench) -> None:
    first, second = run(bench, 1), run(bench, 2)
    assert [state.setpoint_sequence for state in first] == list(range(1, TICKS + 1))
    assert [state.sequence for state in first] == list(range(1, TICKS + 1))
    assert first[-1].last
    for one, other in zip(first, second, strict=True):
        for name in ("reference_mm", "position_mm", "velocity_mm_s", "tracking_error_mm", "control_signal_volts"):
            assert getattr(one, name) == getattr(other, name)
    assert max(abs(state.position_mm[0] - state.reference_mm[0]) for state in first) < 0.05


def test_a_lost_set_point_is_a_fault_and_the_next_program_runs(bench: Bench) -> None:
    bench.move(3, left_out=100)
    status = bench.until_state(NodeStatus.FAULT, 3)
    failure = failure_of_status(status)
    assert failure is not None
    assert failure.kind is FailureKind.SEQUENCE_GAP
    assert failure.message == (
        "/axis_setpoint: program 3 has sequence 101, expected 100: a message was lost, execute the program again"
    )
    assert len(run(bench, 4)) == TICKS
