"""How much of each limit a feed profile uses, span by span, on a grid finer than the optimisation's."""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.feedrate.profile import FeedProfile
from feedopt_core.limits.axis_limits import ONE_SIDED_MM, KinematicLimits, axis_geometry, q_limit
from feedopt_core.path.sampling import samples_between
from feedopt_core.path.toolpath import Toolpath

_LEAST_SAMPLES = 25


def limit_ratios(toolpath: Toolpath, limits: KinematicLimits, profile: FeedProfile) -> FloatArray:
    """Largest ratio of feed, velocity, acceleration and jerk to their limits on each element, shape (m,).

    Args:
        toolpath: holds the profile's arc lengths.
        limits: of the axes and the feed.
        profile: QUADRATIC elements only.
    """
    samples = samples_between(toolpath, profile.s_mm, _LEAST_SAMPLES)
    e = samples.owner
    widths = np.diff(profile.s_mm)[e]
    inset = np.minimum(ONE_SIDED_MM, 1e-3 * widths)
    x = inset + samples.z * (widths - 2.0 * inset)
    geometry = axis_geometry(toolpath, limits.axis_matrix, profile.s_mm[e] + x)
    bend = profile.d2q_ds2_per_s2[e]
    slope = profile.dq_ds_mm_s2[e] + bend * x
    q = profile.q_mm2_s2[e] + (profile.dq_ds_mm_s2[e] + 0.5 * bend * x) * x
    acceleration = np.abs(geometry.g2 * q + 0.5 * geometry.g1 * slope) / limits.acceleration_mm_s2[:, None]
    jerk = np.sqrt(q) * np.abs(geometry.g3 * q + 1.5 * geometry.g2 * slope + 0.5 * geometry.g1 * bend)
    jerk /= limits.jerk_mm_s3[:, None]
    ratios = np.maximum(np.sqrt(q / q_limit(geometry, limits)), np.max(np.maximum(acceleration, jerk), axis=0))
    return np.asarray(np.maximum.reduceat(ratios, samples.first))
