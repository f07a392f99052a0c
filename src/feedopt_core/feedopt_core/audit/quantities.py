"""Rows of a report from sampled axis motion, the same for both grids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.report import AuditRow
from feedopt_core.config.machine import Machine


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


def drive_response(machine: Machine, motion: AxisMotion) -> tuple[FloatArray, FloatArray] | None:
    """Control signal (V) and tracking error (mm) by the machine file's drive model, shape (n_axes, n); None without one."""
    drive = machine.drive
    if drive is None:
        return None
    m, b, c, d, kv, ka, kj = (
        np.array(values)[:, None]
        for values in (
            drive.inertia_volts_s2_mm,
            drive.viscous_volts_s_mm,
            drive.offset_volts,
            drive.coulomb_volts,
            drive.tracking_kv_s,
            drive.tracking_ka_s2,
            drive.tracking_kj_s3,
        )
    )
    v, a, j = motion.velocity_mm_s, motion.acceleration_mm_s2, motion.jerk_mm_s3
    return m * a + b * v + c + d * np.sign(v), kv * v + ka * a + kj * j


def worst_rows(
    grid: str, machine: Machine, quantity: str, values: FloatArray, limits: tuple[float, ...], motion: AxisMotion
) -> list[AuditRow]:
    """One row an axis for the largest absolute value, shape of values (n_axes, n)."""
    rows = []
    for name, row, limit in zip(machine.axis_names, np.abs(values), limits, strict=True):
        # argmax finds a NaN first, so it cannot hide.
        at = int(np.argmax(row))
        value = float(row[at])
        rows.append(AuditRow(grid, name, quantity, value, limit, value / limit, float(motion.s_mm[at]), float(motion.t_s[at])))
    return rows


def motion_rows(grid: str, machine: Machine, motion: AxisMotion) -> list[AuditRow]:
    """Rows of velocity, acceleration, jerk and, with a drive model, control signal and tracking error."""
    rows = worst_rows(grid, machine, "velocity", motion.velocity_mm_s, machine.velocity_limit_mm_s, motion)
    rows += worst_rows(grid, machine, "acceleration", motion.acceleration_mm_s2, machine.acceleration_limit_mm_s2, motion)
    rows += worst_rows(grid, machine, "jerk", motion.jerk_mm_s3, machine.jerk_limit_mm_s3, motion)
    response = drive_response(machine, motion)
    if response is not None and machine.control_limit_volts is not None and machine.tracking_error_limit_mm is not None:
        rows += worst_rows(grid, machine, "control", response[0], machine.control_limit_volts, motion)
        rows += worst_rows(grid, machine, "tracking_error", response[1], machine.tracking_error_limit_mm, motion)
    return rows
