"""Control laws of one axis: cascaded P-PI with feed-forward, and adaptive sliding mode.

Their only inputs are the set point (position, velocity, acceleration) and the encoder position of each servo period.
"""

from __future__ import annotations

import math
from typing import Protocol

from router_sim.parameters import ControllerKind, ServoParameters
from router_sim.servo_tuning import feed_forward_gains


class AxisController(Protocol):
    """Control law of one axis."""

    def reset(self, measured_mm: float) -> None:
        """Start from standstill at a measured position."""

    def control_signal(
        self, position_mm: float, velocity_mm_s: float, acceleration_mm_s2: float, measured_mm: float
    ) -> float:
        """Control signal in V, within saturation, for the set point and the measured position of one tick."""


def make_controller(
    kind: ControllerKind, servo: ServoParameters, saturation_volts: float, period_s: float
) -> AxisController:
    """Create the control law of one axis.

    Args:
        kind: P-PI or sliding mode.
        servo: settings of the axis.
        saturation_volts: magnitude of the control signal at which the amplifier saturates, for anti-windup.
        period_s: period of the servo loop.
    """
    if kind is ControllerKind.P_PI:
        return CascadedController(servo, saturation_volts, period_s)
    return SlidingModeController(servo, saturation_volts, period_s)


class VelocityEstimate:
    """Velocity from the encoder: backward difference through a first-order filter."""

    def __init__(self, filter_s: float, period_s: float) -> None:
        self._period_s = period_s
        self._retained = math.exp(-period_s / filter_s) if filter_s > 0.0 else 0.0
        self.reset(0.0)

    def reset(self, measured_mm: float) -> None:
        """Start from standstill at a measured position."""
        self._measured_mm = measured_mm
        self._velocity_mm_s = 0.0

    def update(self, measured_mm: float) -> float:
        """Velocity in mm/s, including the next measured position."""
        difference_mm_s = (measured_mm - self._measured_mm) / self._period_s
        self._measured_mm = measured_mm
        self._velocity_mm_s = self._retained * self._velocity_mm_s + (1.0 - self._retained) * difference_mm_s
        return self._velocity_mm_s


class CascadedController:
    """P position loop around a PI velocity loop, with feed-forward of velocity, acceleration, jerk and friction.

    Feed-forward gains come from :func:`router_sim.servo_tuning.feed_forward_gains`. The integrator is held
    while the output is saturated and would increase further (anti-windup), and during a commanded standstill within the
    in-position window. Otherwise it would integrate an error below one encoder count, and the axis would never come to
    standstill.
    """

    def __init__(self, servo: ServoParameters, saturation_volts: float, period_s: float) -> None:
        self._servo = servo
        self._saturation_volts = saturation_volts
        self._period_s = period_s
        self._gains = feed_forward_gains(servo, period_s)
        self._integral_per_tick = servo.velocity_integral_per_s * period_s
        self._estimate = VelocityEstimate(servo.velocity_filter_s, period_s)
        self.reset(0.0)

    def reset(self, measured_mm: float) -> None:
        """Start from standstill at a measured position."""
        self._estimate.reset(measured_mm)
        self._integral_mm_s = 0.0
        self._acceleration_mm_s2 = 0.0

    def control_signal(
        self, position_mm: float, velocity_mm_s: float, acceleration_mm_s2: float, measured_mm: float
    ) -> float:
        """Control signal in V for one tick; see :class:`AxisController`."""
        servo, gains, limit = self._servo, self._gains, self._saturation_volts
        jerk_mm_s3 = (acceleration_mm_s2 - self._acceleration_mm_s2) / self._period_s
        self._acceleration_mm_s2 = acceleration_mm_s2
        error_mm = position_mm - measured_mm
        command_mm_s = gains.velocity_ratio * velocity_mm_s + servo.position_gain_per_s * error_mm
        velocity_error_mm_s = command_mm_s - self._estimate.update(measured_mm)
        feed_forward = (
            gains.viscous_volts_s_mm * velocity_mm_s
            + gains.inertia_volts_s2_mm * acceleration_mm_s2
            + gains.jerk_volts_s3_mm * jerk_mm_s3
            + friction_feed_forward_volts(servo, velocity_mm_s)
        )
        integral_mm_s = self._integral_mm_s
        if not in_position(servo, velocity_mm_s, acceleration_mm_s2, error_mm):
            integral_mm_s += self._integral_per_tick * velocity_error_mm_s
        volts = servo.velocity_gain_volts_s_mm * (velocity_error_mm_s + integral_mm_s) + feed_forward
        if abs(volts) <= limit or volts * velocity_error_mm_s < 0.0:
            self._integral_mm_s = integral_mm_s
        return min(max(volts, -limit), limit)


class SlidingModeController:
    """Adaptive sliding-mode control of [H] section 4.5, table 4-2, with one disturbance estimate per axis.

    Sliding variable ``sigma = lambda (r - x) + (dr/dt - dx/dt)``. The control signal cancels the drive model and drives
    sigma to zero. An integrator of sigma estimates the disturbance that the model omits (friction, load, cutting
    force)::

        u = m (lambda (dr/dt - dx/dt) + d2r/dt2) + b dx/dt + d_hat + Ks sigma,    d d_hat/dt = rho kappa sigma

    kappa is 0 if the estimate would leave its bounds, which is also the anti-windup; otherwise it is 1. For a constant
    disturbance d, the Lyapunov function ``(m sigma^2 + (d - d_hat)^2 / rho) / 2`` decreases with ``-Ks sigma^2``.
    The gains of the table refer to radians of the motor: see docs/simulated_router.md.
    """

    def __init__(self, servo: ServoParameters, saturation_volts: float, period_s: float) -> None:
        self._servo = servo
        self._saturation_volts = saturation_volts
        self._gain_volts_s_mm = servo.sliding_gain_volts_s_rad / servo.transmission_mm_rad
        self._adaptation_per_tick_volts_s_mm = servo.adaptation_gain_volts_rad / servo.transmission_mm_rad * period_s
        self._estimate = VelocityEstimate(servo.velocity_filter_s, period_s)
        self.reset(0.0)

    def reset(self, measured_mm: float) -> None:
        """Start from standstill at a measured position; the disturbance estimate starts at the model's load."""
        self._estimate.reset(measured_mm)
        self._disturbance_volts = self._servo.model_offset_volts

    def control_signal(
        self, position_mm: float, velocity_mm_s: float, acceleration_mm_s2: float, measured_mm: float
    ) -> float:
        """Control signal in V for one tick; see :class:`AxisController`."""
        servo, limit = self._servo, self._saturation_volts
        bandwidth_rad_s, largest_volts = servo.sliding_bandwidth_rad_s, servo.disturbance_limit_volts
        measured_mm_s = self._estimate.update(measured_mm)
        error_mm = position_mm - measured_mm
        error_mm_s = velocity_mm_s - measured_mm_s
        sliding_mm_s = bandwidth_rad_s * error_mm + error_mm_s
        disturbance_volts = self._disturbance_volts
        if not in_position(servo, velocity_mm_s, acceleration_mm_s2, error_mm):
            disturbance_volts += self._adaptation_per_tick_volts_s_mm * sliding_mm_s
            disturbance_volts = min(max(disturbance_volts, -largest_volts), largest_volts)
        volts = (
            servo.model_inertia_volts_s2_mm * (bandwidth_rad_s * error_mm_s + acceleration_mm_s2)
            + servo.model_viscous_volts_s_mm * measured_mm_s
            + disturbance_volts
            + self._gain_volts_s_mm * sliding_mm_s
        )
        self._disturbance_volts = disturbance_volts
        return min(max(volts, -limit), limit)


def friction_feed_forward_volts(servo: ServoParameters, velocity_mm_s: float) -> float:
    """Constant load plus Coulomb friction of the servo's model, in the direction of the velocity reference."""
    if velocity_mm_s > 0.0:
        return servo.model_offset_volts + servo.model_coulomb_positive_volts
    if velocity_mm_s < 0.0:
        return servo.model_offset_volts - servo.model_coulomb_negative_volts
    return servo.model_offset_volts


def in_position(servo: ServoParameters, velocity_mm_s: float, acceleration_mm_s2: float, error_mm: float) -> bool:
    """Whether the set point is at standstill and the axis has reached it."""
    return velocity_mm_s == 0.0 and acceleration_mm_s2 == 0.0 and abs(error_mm) <= servo.in_position_window_mm
