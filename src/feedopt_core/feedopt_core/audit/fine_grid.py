"""Audit of a feed profile between the points of its optimisation: r(s) and s(t) alone, no row of the solver."""

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
"""Of the arc length as a number: two paths to it may have been rounded differently."""
_FIRST, _SECOND, _THIRD = 0, 1, 2
"""Places of the derivatives by arc length, and of velocity, acceleration and jerk."""


def audit_profile(toolpath: Toolpath, profile: FeedProfile, machine: Machine, t_start_s: float = 0.0) -> AuditReport:
    """Worst ratios of a profile at nine or more instants of each element, both its ends included.

    Where the path bends sharply there are more (see :func:`samples_between`).

    Args:
        toolpath: holds the profile's arc lengths.
        profile: the profile.
        machine: whose limits count.
        t_start_s: time at the start of the profile, for the report.
    """
    samples = samples_between(toolpath, profile.s_mm, _INSTANTS)
    # A hair inside the ends: the jerk jumps there, and so may the path's derivatives.
    z = np.clip(samples.z, _INSET, 1.0 - _INSET)
    tau_s = z * np.diff(profile.times_s)[samples.owner]
    states = profile.states_within(samples.owner, tau_s)
    # Near rest such a hair of time is no way at all: behind an exact stop the path leaves in another direction.
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
