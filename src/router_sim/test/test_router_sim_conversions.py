"""Set points in, states out; joint states in SI."""

from __future__ import annotations

from array import array

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from feedopt_msgs.msg import AxisSetpoint, AxisState
from feedopt_node.conversions import time_message
from router_sim.conversions import fill_joint_state, fill_state, setpoint_rows
from router_sim.router import AxisStates

STATES = AxisStates(
    reference_mm=(1.0, 2.0),
    position_mm=(0.99, 2.01),
    velocity_mm_s=(10.0, -20.0),
    tool_position_mm=(0.98, 2.02),
    tracking_error_mm=(0.01, -0.01),
    control_signal_volts=(3.0, -10.0),
    saturated=(False, True),
)


def setpoint() -> AxisSetpoint:
    message = AxisSetpoint(
        stamp=time_message(1_234_567_890),
        program_id=3,
        sequence=9,
        tick=-41,
        last=True,
        position_mm=array("d", [1.0, 2.0]),
        velocity_mm_s=array("d", [10.0, -20.0]),
        acceleration_mm_s2=array("d", [0.5, 0.25]),
    )
    return deserialize_message(serialize_message(message), AxisSetpoint)


def test_a_set_point_becomes_rows() -> None:
    assert setpoint_rows(setpoint()) == ([1.0, 2.0], [10.0, -20.0], [0.5, 0.25])


def test_a_state_answers_its_set_point() -> None:
    message = AxisState()
    fill_state(message, setpoint(), 8, STATES)
    again = deserialize_message(serialize_message(message), AxisState)
    assert (again.program_id, again.sequence, again.setpoint_sequence, again.tick, again.last) == (3, 8, 9, -41, True)
    assert (again.stamp.sec, again.stamp.nanosec) == (1, 234_567_890)
    for name in ("reference_mm", "position_mm", "velocity_mm_s", "tracking_error_mm", "control_signal_volts"):
        assert tuple(getattr(again, name)) == getattr(STATES, name)
    assert list(again.saturated) == [False, True]


def test_joint_states_are_in_metres() -> None:
    state, joints = AxisState(), JointState(name=["X", "Y"])
    fill_state(state, setpoint(), 8, STATES)
    fill_joint_state(joints, state)
    again = deserialize_message(serialize_message(joints), JointState)
    assert again.name == ["X", "Y"]
    assert list(again.position) == pytest.approx([0.99e-3, 2.01e-3])
    assert list(again.velocity) == pytest.approx([10.0e-3, -20.0e-3])
    assert again.header.stamp.nanosec == 234_567_890
