"""Stopping distance within acceleration and jerk limits, from which window sizes follow."""

from __future__ import annotations

import math

import numpy as np

from feedopt_core.machine.limits import KinematicLimits


def stopping_distance_mm(v_mm_s: float, a_mm_s2: float, j_mm_s3: float) -> float:
    """Distance to stop from v within acceleration a and jerk j on a straight line (thesis section 3.7), mm."""
    if v_mm_s >= a_mm_s2**2 / j_mm_s3:
        return 0.5 * v_mm_s * (v_mm_s / a_mm_s2 + a_mm_s2 / j_mm_s3)
    return v_mm_s * math.sqrt(v_mm_s / j_mm_s3)


def longest_stop_mm(limits: KinematicLimits) -> float:
    """Longest stopping distance of any axis from its largest velocity, mm."""
    feeds = np.minimum(limits.velocity_mm_s, limits.feed_mm_s)
    return max(
        stopping_distance_mm(float(v), float(a), float(j))
        for v, a, j in zip(feeds, limits.acceleration_mm_s2, limits.jerk_mm_s3, strict=True)
    )
