"""Rows of an audit report from sampled axis motion; both grids use the same functions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.compiled import compiled
from feedopt_core.machine.machine_file import DriveModel, Machine, TrackingModel
from feedopt_core.motion.certificate import AuditRow


@dataclass(frozen=True)
class AxisMotion:
    """Sampled motion; arrays of shape (n_axes, n), s_mm and t_s of shape (n,).

    ``jerk_mm_s3`` may be sampled at other instants than velocity and acceleration; it then has its own s and t.
    """

    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    jerk_mm_s3: FloatArray
    s_mm: FloatArray
    t_s: FloatArray


def control_signal(drive: DriveModel, motion: AxisMotion) -> FloatArray:
    """Control signal by the drive model, shape (n_axes, n), V."""
    # With one memory layout, one compiled version serves both grids.
    v, a = np.ascontiguousarray(motion.velocity_mm_s), np.ascontiguousarray(motion.acceleration_mm_s2)
    inertia, viscous, offset, coulomb = (
        np.array(values)
        for values in (drive.inertia_volts_s2_mm, drive.viscous_volts_s_mm, drive.offset_volts, drive.coulomb_volts)
    )
    return _control_signal(inertia, viscous, offset, coulomb, v, a)


@compiled
def _control_signal(
    inertia: FloatArray, viscous: FloatArray, offset: FloatArray, coulomb: FloatArray, v: FloatArray, a: FloatArray
) -> FloatArray:
    out = np.empty(v.shape)
    for axis in range(v.shape[0]):
        for i in range(v.shape[1]):
            friction = coulomb[axis] * np.sign(v[axis, i])
            out[axis, i] = inertia[axis] * a[axis, i] + viscous[axis] * v[axis, i] + offset[axis] + friction
    return out


def tracking_error(tracking: TrackingModel, motion: AxisMotion) -> FloatArray:
    """Quasi-static tracking error by the tracking model, shape (n_axes, n), mm."""
    rows = (tracking.tracking_kv_s, tracking.tracking_ka_s2, tracking.tracking_kj_s3)
    kv, ka, kj = (np.array(row)[:, None] for row in rows)
    return kv * motion.velocity_mm_s + ka * motion.acceleration_mm_s2 + kj * motion.jerk_mm_s3


def worst_rows(
    grid: str,
    machine: Machine,
    quantity: str,
    values: FloatArray,
    limits: tuple[float, ...],
    at: tuple[FloatArray, FloatArray],
) -> list[AuditRow]:
    """One row for each axis that has a limit, with the largest absolute value.

    Args:
        grid, quantity: grid and quantity of the rows.
        machine: machine with the names of the axes.
        values: shape (n_axes, n).
        limits: one for each axis; an axis with an infinite limit gets no row.
        at: arc length and time of the values, shape (n,) each.
    """
    rows = []
    for name, row, limit in zip(machine.axis_names, np.abs(values), limits, strict=True):
        if math.isinf(limit):
            continue
        # argmax returns the first NaN if there is one, so NaN is always reported.
        worst = int(np.argmax(row))
        value = float(row[worst])
        place = (float(at[0][worst]), float(at[1][worst]))
        rows.append(AuditRow(grid, name, quantity, value, limit, value / limit, *place))
    return rows


def kinematic_rows(grid: str, machine: Machine, motion: AxisMotion) -> list[AuditRow]:
    """Rows of velocity, acceleration and jerk."""
    at = (motion.s_mm, motion.t_s)
    rows = worst_rows(grid, machine, "velocity", motion.velocity_mm_s, machine.velocity_limit_mm_s, at)
    rows += worst_rows(grid, machine, "acceleration", motion.acceleration_mm_s2, machine.acceleration_limit_mm_s2, at)
    rows += worst_rows(grid, machine, "jerk", motion.jerk_mm_s3, machine.jerk_limit_mm_s3, at)
    return rows


def drive_rows(grid: str, machine: Machine, motion: AxisMotion) -> list[AuditRow]:
    """Rows of control signal and tracking error, where the machine has these models.

    The tracking error is compared with the part of its limit that a plan may use.
    """
    at, rows = (motion.s_mm, motion.t_s), list[AuditRow]()
    if machine.drive is not None and machine.control_limit_volts is not None:
        signal_volts = control_signal(machine.drive, motion)
        rows += worst_rows(grid, machine, "control", signal_volts, machine.control_limit_volts, at)
    if machine.tracking is not None and machine.planned_tracking_error_mm is not None:
        error_mm = tracking_error(machine.tracking, motion)
        rows += worst_rows(grid, machine, "tracking_error", error_mm, machine.planned_tracking_error_mm, at)
    return rows
