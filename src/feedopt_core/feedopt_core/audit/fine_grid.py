"""Audit of a feed profile between the points of its optimisation: r(s) and s(t) alone, no row of the solver."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.audit.quantities import AxisMotion, drive_rows, kinematic_rows
from feedopt_core.audit.report import AuditReport, AuditRow
from feedopt_core.config.machine import Machine
from feedopt_core.feedrate.profile import FeedProfile
from feedopt_core.path.sampling import samples_between
from feedopt_core.path.toolpath import Toolpath

GRID = "fine"
_INSTANTS = 9
_INSET = 1e-6


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
    t_s = profile.times_s[samples.owner] + z * np.diff(profile.times_s)[samples.owner]
    states = profile.states_at(t_s)
    points = toolpath.evaluate(states.s_mm)
    k = machine.axis_matrix()
    g1, g2, g3 = ((values @ k.T).T for values in (points.dr_ds, points.d2r_ds2, points.d3r_ds3))
    v, a, j = states.v_mm_s, states.a_mm_s2, states.j_mm_s3
    motion = AxisMotion(
        velocity_mm_s=g1 * v,
        acceleration_mm_s2=g2 * v**2 + g1 * a,
        jerk_mm_s3=g3 * v**3 + 3.0 * g2 * v * a + g1 * j,
        s_mm=states.s_mm,
        t_s=t_start_s + t_s,
    )
    rows = [
        _feedrate_row(toolpath, machine, states.v_mm_s, motion),
        *kinematic_rows(GRID, machine, motion),
        *drive_rows(GRID, machine, motion),
    ]
    return AuditReport(tuple(rows))


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
