"""Kinematic limits within which control signal and tracking error hold in the worst case (thesis section 3.4.1)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.errors import InfeasibleLimitsError
from feedopt_core.machine.limits import KinematicLimits, MotionLimits
from feedopt_core.machine.machine_file import DriveModel, Machine, TrackingModel

_LEAST_ACCELERATION_SHARE = 0.2
"""Share of control signal or tracking error that velocity leaves to acceleration; else the velocity is lowered."""
_LEAST_JERK_SHARE = 0.1
"""Share of the tracking error that velocity and acceleration leave to jerk."""

_RAMP_SHARE = 0.4
"""Share of the tracking error that the acceleration may take on a standstill element."""
_BRAKING_JERK_SHARE = 0.2
"""Share of the tracking error that the jerk takes at the ends of a stop."""


def derived_limits(machine: Machine) -> KinematicLimits:
    """Kinematic limits of the machine, lowered for each axis until no motion within them can violate a drive limit.

    ``m a + b v + |c| + d <= u`` and ``Kv v + Ka a + Kj j <= e`` hold even if v, a and j are largest at the same time.
    Acceleration is lowered first, then velocity, then jerk.

    Raises:
        InfeasibleLimitsError: friction and offset alone need the whole control signal.
    """
    limits = KinematicLimits.of(machine)
    v, a, j = _largest_velocity(limits), limits.acceleration_mm_s2.copy(), limits.jerk_mm_s3.copy()
    for i, name in enumerate(machine.axis_names):
        if machine.drive is not None and machine.control_limit_volts is not None:
            v[i], a[i] = _within_control(machine.drive, machine.control_limit_volts[i], i, name, v[i], a[i])
        if machine.tracking is not None and machine.planned_tracking_error_mm is not None:
            v[i], a[i], j[i] = _within_tracking(
                machine.tracking, machine.planned_tracking_error_mm[i], i, v[i], a[i], j[i]
            )
    return KinematicLimits(limits.axis_matrix, limits.feed_mm_s, v, a, j)


def attainable_limits(limits: MotionLimits) -> KinematicLimits:
    """Largest velocity, acceleration and jerk of each axis, each one as if the other two were zero.

    All are finite for a machine file that passed its checks. They determine the size of standstill elements and
    windows, and the first guesses.
    """
    kinematic = limits.kinematic
    v, a, j = _largest_velocity(kinematic), kinematic.acceleration_mm_s2, kinematic.jerk_mm_s3
    with np.errstate(divide="ignore"):
        if limits.control is not None:
            control = limits.control
            left_volts = control.limit_volts - np.abs(control.offset_volts) - control.coulomb_volts
            v = np.minimum(v, left_volts / control.viscous_volts_s_mm)
            a = np.minimum(a, left_volts / control.inertia_volts_s2_mm)
        if limits.tracking is not None:
            tracking = limits.tracking
            v = np.minimum(v, tracking.limit_mm / np.abs(tracking.kv_s))
            a = np.minimum(a, tracking.limit_mm / np.abs(tracking.ka_s2))
            j = np.minimum(j, tracking.limit_mm / np.abs(tracking.kj_s3))
    return KinematicLimits(kinematic.axis_matrix, kinematic.feed_mm_s, v, a, j)


def ramp_limits(limits: MotionLimits) -> KinematicLimits:
    """Attainable limits for standstill elements, with a lower acceleration where the machine has a tracking model.

    Acceleration and jerk share the limit of the tracking error: what the acceleration takes is lost to the jerk. Up to
    the acceleration returned here, the jerk may stay as large as it is at the standstill.
    """
    reach, tracking = attainable_limits(limits), limits.tracking
    if tracking is None:
        return reach
    with np.errstate(divide="ignore"):
        a = np.minimum(reach.acceleration_mm_s2, _RAMP_SHARE * tracking.limit_mm / np.abs(tracking.ka_s2))
    return replace(reach, acceleration_mm_s2=a)


def braking_limits(limits: MotionLimits) -> KinematicLimits:
    """Limits within which every axis can brake from its largest velocity, without the help of viscous friction.

    Coulomb friction helps to brake and is counted. Acceleration and jerk share the tracking error; the part of the
    velocity has the opposite sign while the axis brakes.
    """
    reach, tracking = attainable_limits(limits), limits.tracking
    a, j = limits.kinematic.acceleration_mm_s2, reach.jerk_mm_s3
    with np.errstate(divide="ignore"):
        if limits.control is not None:
            control = limits.control
            braking_volts = control.limit_volts - np.abs(control.offset_volts) + control.coulomb_volts
            a = np.minimum(a, braking_volts / control.inertia_volts_s2_mm)
        if tracking is not None:
            a = np.minimum(a, (1.0 - _BRAKING_JERK_SHARE) * tracking.limit_mm / np.abs(tracking.ka_s2))
            j = np.minimum(
                limits.kinematic.jerk_mm_s3, _BRAKING_JERK_SHARE * tracking.limit_mm / np.abs(tracking.kj_s3)
            )
    return KinematicLimits(reach.axis_matrix, reach.feed_mm_s, reach.velocity_mm_s, a, j)


def _largest_velocity(limits: KinematicLimits) -> FloatArray:
    """Largest velocity of each axis under velocity and feed limits, shape (n_axes,)."""
    return np.asarray(
        np.minimum(limits.velocity_mm_s, limits.feed_mm_s * np.linalg.norm(limits.axis_matrix, axis=1)),
        dtype=np.float64,
    )


def _within_control(
    drive: DriveModel, limit_volts: float, axis: int, name: str, v: float, a: float
) -> tuple[float, float]:
    friction = abs(drive.offset_volts[axis]) + drive.coulomb_volts[axis]
    if friction >= limit_volts:
        raise InfeasibleLimitsError(
            f"friction and offset need {friction:g} V of the {limit_volts:g} V allowed; raise control_limit_volts",
            quantity="control",
            axis=name,
            s_mm=None,
            ratio=friction / limit_volts,
        )
    return _shared(limit_volts - friction, drive.viscous_volts_s_mm[axis], drive.inertia_volts_s2_mm[axis], v, a)


def _within_tracking(
    tracking: TrackingModel, limit_mm: float, axis: int, v: float, a: float, j: float
) -> tuple[float, float, float]:
    per_v, per_a, per_j = (
        abs(row[axis]) for row in (tracking.tracking_kv_s, tracking.tracking_ka_s2, tracking.tracking_kj_s3)
    )
    # Where the jerk causes tracking error, it gets a share: without jerk no acceleration can be built up.
    for_jerk = min(per_j * j, _LEAST_JERK_SHARE * limit_mm) if per_j > 0.0 else 0.0
    v, a = _shared(limit_mm - for_jerk, per_v, per_a, v, a)
    left_mm = limit_mm - per_v * v - per_a * a
    return v, a, min(j, left_mm / per_j) if per_j > 0.0 else j


def _shared(budget: float, per_velocity: float, per_acceleration: float, v: float, a: float) -> tuple[float, float]:
    """Velocity and acceleration limits that keep ``per_velocity v + per_acceleration a`` within a budget."""
    if per_velocity * v + per_acceleration * a <= budget:
        return v, a
    most_velocity = (1.0 - _LEAST_ACCELERATION_SHARE) * budget
    if per_velocity * v > most_velocity:
        v = most_velocity / per_velocity
    if per_acceleration > 0.0:
        a = min(a, (budget - per_velocity * v) / per_acceleration)
    return v, a
