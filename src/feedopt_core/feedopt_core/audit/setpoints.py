"""Audit of set points by finite differences, with the standstill before and after: the motion that the drives receive.

Differences of order n over the period h are averages of the n-th derivative over n periods. So where the motion keeps
its limits at every instant, the differences keep them too. A violation between two set points shows on the fine grid.
"""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.quantities import AxisMotion, drive_rows, worst_rows
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.certificate import AuditReport

GRID = "set points"
_STANDSTILL_TICKS = 3
_LONGEST_DRIVE_PERIOD_S = 0.0025
"""Above this period, differences over four periods are too coarse for the drive models; the fine grid checks these."""


def audit_setpoints(
    position_mm: FloatArray, s_mm: FloatArray, period_s: float, machine: Machine, t_start_s: float = 0.0
) -> AuditReport:
    """Largest ratios to the limits of equidistant set points that start and end at standstill.

    Control signal and tracking error combine differences over two to four periods. With a period of 10 ms their error
    was 0.2 % of the limit, so they are checked here only up to a period of 2.5 ms.

    Args:
        position_mm: axis positions, shape (n, n_axes), first to last set point of the motion.
        s_mm: arc length of each set point, shape (n,), for the report only.
        period_s: time between set points.
        machine: machine with the limits.
        t_start_s: time of the first set point, for the report.
    """
    x = np.pad(position_mm, ((_STANDSTILL_TICKS, _STANDSTILL_TICKS), (0, 0)), mode="edge").T
    s = np.pad(s_mm, _STANDSTILL_TICKS, mode="edge")
    t = np.asarray(t_start_s + period_s * (np.arange(x.shape[1]) - _STANDSTILL_TICKS), dtype=np.float64)
    # Each difference is taken at its own instants, so no peak is averaged away.
    velocity = np.diff(x, axis=1) / period_s
    jerk = np.diff(x, n=3, axis=1) / period_s**3
    # The drive models need all differences at the same instants: the set points.
    inner = slice(2, -2)
    motion = AxisMotion(
        velocity_mm_s=((x[:, 2:] - x[:, :-2]) / (2.0 * period_s))[:, 1:-1],
        acceleration_mm_s2=(np.diff(x, n=2, axis=1) / period_s**2)[:, 1:-1],
        jerk_mm_s3=0.5 * (jerk[:, 1:] + jerk[:, :-1]),
        s_mm=s[inner],
        t_s=t[inner],
    )
    rows = []
    for quantity, values, limits, lag in (
        ("velocity", velocity, machine.velocity_limit_mm_s, 1),
        ("acceleration", motion.acceleration_mm_s2, machine.acceleration_limit_mm_s2, 2),
        ("jerk", jerk, machine.jerk_limit_mm_s3, 2),
    ):
        at = slice(lag, lag + values.shape[1])
        rows += worst_rows(GRID, machine, quantity, values, limits, (s[at], t[at]))
    if period_s <= _LONGEST_DRIVE_PERIOD_S:
        rows += drive_rows(GRID, machine, motion)
    return AuditReport(tuple(rows))
