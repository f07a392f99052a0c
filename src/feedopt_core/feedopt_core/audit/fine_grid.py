"""Audit of a feed profile between the points of its optimisation, from r(s) and s(t) only, not from solver rows."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.quantities import AxisMotion, drive_rows, kinematic_rows
from feedopt_core.compiled import compiled
from feedopt_core.geometry.sampling import samples_between
from feedopt_core.geometry.toolpath import Toolpath
from feedopt_core.machine.machine_file import Machine
from feedopt_core.motion.certificate import AuditReport, AuditRow
from feedopt_core.motion.profile import FeedProfile

GRID = "fine"
_INSTANTS = 9
_INSET = 1e-6
_INSET_OF_WAY = 1e-9
_INSET_STEPS = 4.0
"""Least inset, in floating-point steps of the arc length: two computations of it may have been rounded differently."""
_FIRST, _SECOND, _THIRD = 0, 1, 2
"""Rows of the derivatives by arc length, and of velocity, acceleration and jerk."""


def audit_profile(toolpath: Toolpath, profile: FeedProfile, machine: Machine, t_start_s: float = 0.0) -> AuditReport:
    """Largest ratios to the limits at nine or more instants of each element of a profile, both ends included.

    Where the path bends sharply there are more instants (see :func:`samples_between`).

    Args:
        toolpath: contains all arc lengths of the profile.
        profile: the profile to audit.
        machine: machine with the limits.
        t_start_s: time at the start of the profile, for the report.
    """
    samples = samples_between(toolpath, profile.s_mm, _INSTANTS)
    # The outer instants are just inside the element: at its ends the jerk jumps, and the path's derivatives may jump.
    z = np.clip(samples.z, _INSET, 1.0 - _INSET)
    tau_s = z * np.diff(profile.times_s)[samples.owner]
    states = profile.states_within(samples.owner, tau_s)
    # Next to a standstill this inset in time is hardly any path. The arc length needs its own inset, because the path
    # may change its direction at an exact stop.
    start_mm, end_mm = profile.s_mm[samples.owner], profile.s_mm[samples.owner + 1]
    inset_mm = np.maximum(_INSET_OF_WAY * (end_mm - start_mm), _INSET_STEPS * np.spacing(end_mm))
    inside_mm = np.clip(states.s_mm, start_mm + inset_mm, end_mm - inset_mm)
    g = toolpath.axis_derivatives(inside_mm, machine.axis_matrix())
    velocity, acceleration, jerk = _axis_motion(g, states.v_mm_s, states.a_mm_s2, states.j_mm_s3)
    t_s = t_start_s + profile.times_s[samples.owner] + tau_s
    motion = AxisMotion(velocity, acceleration, jerk, states.s_mm, t_s)
    rows = [
        _feedrate_row(toolpath, machine, states.v_mm_s, motion),
        *kinematic_rows(GRID, machine, motion),
        *drive_rows(GRID, machine, motion),
    ]
    return AuditReport(tuple(rows))


@compiled
def _axis_motion(g: FloatArray, v: FloatArray, a: FloatArray, j: FloatArray) -> FloatArray:
    """Velocity, acceleration and jerk of the axes, shape (3, n_axes, n), by the chain rule.

    Args:
        g: first three derivatives of the axis positions by arc length, shape (3, n_axes, n).
        v, a, j: ds/dt, d2s/dt2 and d3s/dt3, shape (n,) each.
    """
    out = np.empty(g.shape)
    for axis in range(g.shape[1]):
        for i in range(g.shape[2]):
            g1, g2, g3 = g[_FIRST, axis, i], g[_SECOND, axis, i], g[_THIRD, axis, i]
            out[_FIRST, axis, i] = g1 * v[i]
            out[_SECOND, axis, i] = g2 * v[i] ** 2 + g1 * a[i]
            out[_THIRD, axis, i] = g3 * v[i] ** 3 + 3.0 * g2 * v[i] * a[i] + g1 * j[i]
    return out


def _feedrate_row(toolpath: Toolpath, machine: Machine, v_mm_s: FloatArray, motion: AxisMotion) -> AuditRow:
    limits = np.minimum(toolpath.feed_limits_mm_s(motion.s_mm), machine.feed_limit_mm_s)
    ratios = v_mm_s / limits
    at = int(np.argmax(ratios))
    return AuditRow(
        GRID,
        "",
        "feedrate",
        float(v_mm_s[at]),
        float(limits[at]),
        float(ratios[at]),
        float(motion.s_mm[at]),
        float(motion.t_s[at]),
    )
