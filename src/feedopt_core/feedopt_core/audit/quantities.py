"""Rows of a report from sampled axis motion, the same for both grids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.report import AuditRow
from feedopt_core.config.machine import DriveModel, Machine, TrackingModel


@dataclass(frozen=True)
class AxisMotion:
    """Sampled motion; shape (n_axes, n) each, s_mm and t_s shape (n,).

    ``jerk_mm_s3`` may be sampled at other instants than the rest; it then has its own s and t.
    """

    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray
    jerk_mm_s3: FloatArray
    s_mm: FloatArray
    t_s: FloatArray


def control_signal(drive: DriveModel, motion: AxisMotion) -> FloatArray:
    """Control signal by the drive model, shape (n_axes, n), V."""
    v, a = motion.velocity_mm_s, motion.acceleration_mm_s2
    coulomb = _column(drive.coulomb_volts) * np.sign(v)
    return (
        _column(drive.inertia_volts_s2_mm) * a
        + _column(drive.viscous_volts_s_mm) * v
        + _column(drive.offset_volts)
        + coulomb
    )


def tracking_error(tracking: TrackingModel, motion: AxisMotion) -> FloatArray:
    """Quasi-static tracking error by the tracking model, shape (n_axes, n), mm."""
    v, a, j = motion.velocity_mm_s, motion.acceleration_mm_s2, motion.jerk_mm_s3
    return (
        _column(tracking.tracking_kv_s) * v
        + _column(tracking.tracking_ka_s2) * a
        + _column(tracking.tracking_kj_s3) * j
    )


def _column(values: tuple[float, ...]) -> FloatArray:
    return np.array(values)[:, None]


def worst_rows(
    grid: str,
    machine: Machine,
    quantity: str,
    values: FloatArray,
    limits: tuple[float, ...],
    at: tuple[FloatArray, FloatArray],
) -> list[AuditRow]:
    """One row an axis for the largest absolute value.

    Args:
        grid, quantity: of the rows.
        machine: for the names of its axes.
        values: shape (n_axes, n).
        limits: one an axis.
        at: arc length and time of the values, shape (n,) each.
    """
    rows = []
    for name, row, limit in zip(machine.axis_names, np.abs(values), limits, strict=True):
        # argmax finds a NaN first, so it cannot hide.
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
    """Rows of control signal and tracking error, where the machine has the models."""
    at, rows = (motion.s_mm, motion.t_s), list[AuditRow]()
    if machine.drive is not None and machine.control_limit_volts is not None:
        signal_volts = control_signal(machine.drive, motion)
        rows += worst_rows(grid, machine, "control", signal_volts, machine.control_limit_volts, at)
    if machine.tracking is not None and machine.tracking_error_limit_mm is not None:
        error_mm = tracking_error(machine.tracking, motion)
        rows += worst_rows(grid, machine, "tracking_error", error_mm, machine.tracking_error_limit_mm, at)
    return rows
