"""The simulated router as a node: one servo step and one axis state for every set point."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

from rclpy.duration import Duration
from sensor_msgs.msg import JointState

from feedopt_core.errors import FeedoptError, failure_of
from feedopt_core.schema import parameter
from feedopt_msgs.msg import AxisSetpoint, AxisState, NodeStatus
from feedopt_node.graph_node import GraphNode
from feedopt_node.parameters import MachineNodeParameters
from feedopt_node.polling import PollingThread
from feedopt_node.private_rclpy import PolledGroup, take_all
from feedopt_node.run import run_node
from feedopt_node.sequence import SequenceCheck
from router_sim.conversions import fill_joint_state, fill_state, setpoint_rows
from router_sim.machine_file import load_matching_router
from router_sim.router import SimulatedRouter

NODE_NAME = "router_sim"
POLL_PERIOD_S = 0.002
DELIVERY_PATIENCE_S = 2.0


@dataclass(frozen=True, kw_only=True)
class RouterSimNodeParameters(MachineNodeParameters):
    """Parameters of the router_sim node; the machine file describes the drives."""

    joint_state_ticks: int = parameter("Set points between two joint states.", default=20, at_least=1, at_most=10_000)


class RouterSimNode(GraphNode[RouterSimNodeParameters]):
    """Follows set points. Time advances by one servo period per set point, not by the clock: runs are reproducible."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME, RouterSimNodeParameters)
        drives = load_matching_router(self.parameters.machine)
        self._router = SimulatedRouter(drives)
        self._check = SequenceCheck("/axis_setpoint")
        self._state = AxisState()
        self._joints = JointState(name=list(drives.axis_names))
        self._sequence = 0
        self._s_mm = 0.0
        self._states = self.publish_topic("/axis_state")
        self._joint_states = self.publish_topic("/joint_states")
        self._setpoints = self.subscribe_topic("/axis_setpoint", self._take_setpoint, group=PolledGroup())
        self.life.progress_from(self._progress)
        self._polling = PollingThread("servo", POLL_PERIOD_S, self._poll, self._end)
        self._polling.start()

    def close(self) -> None:
        """End the servo thread."""
        self._polling.close()

    def _poll(self) -> None:
        for setpoint, _ in take_all(self._setpoints):
            self._take_setpoint(setpoint)

    def _end(self, error: Exception) -> None:
        if not self.life.ended.done():
            self.life.ended.set_exception(error)

    def _take_setpoint(self, setpoint: AxisSetpoint) -> None:
        try:
            if not self._check.accept(setpoint.program_id, setpoint.sequence):
                return
            position_mm, velocity_mm_s, acceleration_mm_s2 = setpoint_rows(setpoint)
            if setpoint.sequence == 1:
                self._router.reset(position_mm)
                self._sequence = 0
                self.life.begin_program(setpoint.program_id)
            states = self._router.step(position_mm, velocity_mm_s, acceleration_mm_s2)
        except FeedoptError as error:
            self._check.close()
            self.get_logger().error(f"program {setpoint.program_id}: {error}")
            self.life.fail(failure_of(error), program_id=setpoint.program_id)
            return
        self._sequence += 1
        self._s_mm = setpoint.s_mm
        fill_state(self._state, setpoint, self._sequence, states)
        self._states.publish(self._state)
        if (self._sequence - 1) % self.parameters.joint_state_ticks == 0:
            fill_joint_state(self._joints, self._state)
            self._joint_states.publish(self._joints)
        if setpoint.last:
            self._check.close()
            self._states.wait_for_all_acked(Duration(seconds=DELIVERY_PATIENCE_S))
            self.life.report(state=NodeStatus.DONE)

    def _progress(self) -> dict[str, Any]:
        return {
            "last_input_sequence": self._sequence,
            "last_output_sequence": self._sequence,
            "s_mm": self._s_mm,
        }


def main() -> None:
    """Run the node."""
    sys.exit(run_node(RouterSimNode))


if __name__ == "__main__":
    main()
