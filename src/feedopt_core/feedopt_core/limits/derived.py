"""Kinematic limits within which the control signal and the tracking error hold in the worst case (thesis section 3.4.1)."""

from __future__ import annotations

import numpy as np

from feedopt_core.config.machine import Machine
from feedopt_core.errors import InfeasibleLimitsError
from feedopt_core.limits.axis_limits import KinematicLimits

_LEAST_ACCELERATION_SHARE = 0.2
"""Share of the control signal or tracking error that velocity must leave to acceleration; beyond it velocity gives way."""


def derived_limits(machine: Machine) -> KinematicLimits:
    """The machine's kinematic limits, lowered axis by axis until its drive limits cannot be exceeded.

    With ``m a + b v + |c| + d <= u`` and ``Kv v + Ka a + Kj j <= e`` at the largest v, a and j at once, no motion within
    the returned limits can break a drive limit. Acceleration gives way first, then velocity, then jerk.

    Raises:
        InfeasibleLimitsError: friction alone needs the whole control signal.
    """
    limits = KinematicLimits.of(machine)
    drive, control, error = machine.drive, machine.control_limit_volts, machine.tracking_error_limit_mm
    if drive is None or control is None or error is None:
        return limits
    v, a, j = limits.velocity_mm_s.copy(), limits.acceleration_mm_s2.copy(), limits.jerk_mm_s3.copy()
    for i, name in enumerate(machine.axis_names):
        free = control[i] - abs(drive.offset_volts[i]) - drive.coulomb_volts[i]
        if free <= 0.0:
            raise InfeasibleLimitsError(
                f"axis {name}: friction and offset need {control[i] - free:g} V of the {control[i]:g} V allowed; raise control_limit_volts",
                quantity="control",
                axis=name,
                s_mm=0.0,
                margin=(control[i] - free) / control[i],
            )
        v[i], a[i] = _shared(free, drive.viscous_volts_s_mm[i], drive.inertia_volts_s2_mm[i], v[i], a[i])
        v[i], a[i] = _shared(error[i], drive.tracking_kv_s[i], drive.tracking_ka_s2[i], v[i], a[i])
        left = error[i] - drive.tracking_kv_s[i] * v[i] - drive.tracking_ka_s2[i] * a[i]
        if drive.tracking_kj_s3[i] * j[i] > left:
            # Where velocity and acceleration use it all, they make room for a jerk that can still build them up.
            shrink = (1.0 - _LEAST_ACCELERATION_SHARE) * error[i] / (error[i] - left)
            if left < _LEAST_ACCELERATION_SHARE * 0.5 * error[i] and shrink < 1.0:
                v[i], a[i] = v[i] * shrink, a[i] * shrink
                left = error[i] - drive.tracking_kv_s[i] * v[i] - drive.tracking_ka_s2[i] * a[i]
            j[i] = min(j[i], left / drive.tracking_kj_s3[i])
    return KinematicLimits(limits.axis_matrix, limits.feed_mm_s, v, a, j)


def _shared(budget: float, per_velocity: float, per_acceleration: float, v: float, a: float) -> tuple[float, float]:
    """Velocity and acceleration limits that keep ``per_velocity v + per_acceleration a`` within a budget."""
    if per_velocity * v + per_acceleration * a <= budget:
        return v, a
    most_velocity = (1.0 - _LEAST_ACCELERATION_SHARE) * budget
    if per_velocity * v > most_velocity:
        v = most_velocity / per_velocity
    if per_acceleration > 0.0:
        a = float(np.minimum(a, (budget - per_velocity * v) / per_acceleration))
    return v, a
