"""How much of each limit a feed profile uses, span by span, on a grid finer than the optimisation's."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.feedrate.profile import FeedProfile
from feedopt_core.limits.axis_limits import KinematicLimits, axis_geometry, q_limit, span_points
from feedopt_core.path.toolpath import Toolpath


def limit_ratios(toolpath: Toolpath, limits: KinematicLimits, profile: FeedProfile, z: FloatArray) -> FloatArray:
    """Largest ratio of feed, velocity, acceleration and jerk to their limits on each element, shape (m,).

    Args:
        toolpath: holds the profile's arc lengths.
        limits: of the axes and the feed.
        profile: QUADRATIC elements only.
        z: points in [0, 1] of each element.
    """
    s_mm = span_points(profile.s_mm, z)
    geometry = axis_geometry(toolpath, limits.axis_matrix, s_mm)
    x = s_mm - profile.s_mm[:-1]
    bend = profile.d2q_ds2_per_s2
    slope = profile.dq_ds_mm_s2 + bend * x
    q = profile.q_mm2_s2 + (profile.dq_ds_mm_s2 + 0.5 * bend * x) * x
    acceleration = np.abs(geometry.g2 * q + 0.5 * geometry.g1 * slope) / limits.acceleration_mm_s2[:, None, None]
    jerk = np.sqrt(q) * np.abs(geometry.g3 * q + 1.5 * geometry.g2 * slope + 0.5 * geometry.g1 * bend)
    jerk /= limits.jerk_mm_s3[:, None, None]
    ratios = np.maximum(np.sqrt(q / q_limit(geometry, limits)), np.max(np.maximum(acceleration, jerk), axis=0))
    return np.asarray(np.max(ratios, axis=0))
