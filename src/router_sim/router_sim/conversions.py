"""Conversion of set points to inputs of a servo step, and of axis states to messages; JointState in SI units."""

from __future__ import annotations

from array import array

from sensor_msgs.msg import JointState

from feedopt_msgs.msg import AxisSetpoint, AxisState
from router_sim.router import AxisStates

_M_PER_MM = 1e-3


def setpoint_rows(message: AxisSetpoint) -> tuple[list[float], list[float], list[float]]:
    """Axis positions (mm), velocities (mm/s) and accelerations (mm/s^2) of a set point, as inputs of a servo step."""
    return message.position_mm.tolist(), message.velocity_mm_s.tolist(), message.acceleration_mm_s2.tolist()


def fill_state(message: AxisState, setpoint: AxisSetpoint, sequence: int, states: AxisStates) -> None:
    """Write the axis states at a set point into a message."""
    message.stamp = setpoint.stamp
    message.program_id = setpoint.program_id
    message.sequence = sequence
    message.setpoint_sequence = setpoint.sequence
    message.tick = setpoint.tick
    message.last = setpoint.last
    message.reference_mm = array("d", states.reference_mm)
    message.position_mm = array("d", states.position_mm)
    message.velocity_mm_s = array("d", states.velocity_mm_s)
    message.tracking_error_mm = array("d", states.tracking_error_mm)
    message.control_signal_volts = array("d", states.control_signal_volts)
    message.saturated = list(states.saturated)


def fill_joint_state(message: JointState, state: AxisState) -> None:
    """Write positions (m) and velocities (m/s) of an axis state into a joint state."""
    message.header.stamp = state.stamp
    message.position = array("d", [value * _M_PER_MM for value in state.position_mm])
    message.velocity = array("d", [value * _M_PER_MM for value in state.velocity_mm_s])
