"""The element of constant jerk that leaves or reaches rest, s = J t^3 / 6: its length and the largest jerk it may have.

With x the distance from rest and q = p x^(4/3), p = (9 J / 2)^(2/3), an axis has (sign: +1 leaving, -1 reaching rest)

    acceleration  p (g2 x^(4/3) + sign 2/3 g1 x^(1/3))
    jerk          p^(3/2) (g3 x^2 + sign 2 g2 x + 2/9 g1)

so every limit on the element is an upper bound of p: nothing is linearised, and true rest (q = 0) is on the path.
"""

from __future__ import annotations

import numpy as np

from feedopt_core.arrays import FloatArray
from feedopt_core.limits.axis_limits import KinematicLimits, axis_geometry, q_limit
from feedopt_core.path.toolpath import Toolpath

_FRACTION = 0.3
_INSIDE_MM = 1e-9
_SAMPLES = np.concatenate([[1e-4], np.linspace(0.02, 1.0, 15)])


def rest_length_mm(toolpath: Toolpath, limits: KinematicLimits, s_rest_mm: float, sign: int) -> float:
    """Length of the element next to rest: a part of the distance in which the jerk builds up the acceleration.

    Args:
        s_rest_mm: arc length of the point of rest.
        sign: +1 where the element leaves rest, -1 where it reaches rest.
    """
    # A hair inside the element: at an exact stop the direction of the path may jump.
    geometry = axis_geometry(toolpath, limits.axis_matrix, np.array([s_rest_mm + sign * _INSIDE_MM]))
    with np.errstate(divide="ignore"):
        jerk = float(np.min(limits.jerk_mm_s3 / np.abs(geometry.g1[:, 0])))
        acceleration = float(np.min(limits.acceleration_mm_s2 / np.abs(geometry.g1[:, 0])))
    return _FRACTION * acceleration**3 / (6.0 * jerk**2)


def rest_scale_limit(
    toolpath: Toolpath, limits: KinematicLimits, s_rest_mm: float, length_mm: float, sign: int, scale: float
) -> float:
    """Largest p = (9 J / 2)^(2/3) of the element of given length next to rest.

    Args:
        s_rest_mm: arc length of the point of rest.
        length_mm: length of the element.
        sign: +1 where it leaves rest, -1 where it reaches rest.
        scale: factor on every limit.
    """
    x = length_mm * _SAMPLES
    geometry = axis_geometry(toolpath, limits.axis_matrix, s_rest_mm + sign * x)
    root = np.cbrt(x)
    acceleration = np.abs(geometry.g2 * root**4 + sign * 2.0 / 3.0 * geometry.g1 * root)
    jerk = np.abs(geometry.g3 * x**2 + sign * 2.0 * geometry.g2 * x + 2.0 / 9.0 * geometry.g1)
    bounds: list[FloatArray] = [
        q_limit(geometry, limits) * scale**2 / root**4,
        scale * limits.acceleration_mm_s2[:, None] / np.maximum(acceleration, 1e-300),
        (scale * limits.jerk_mm_s3[:, None] / np.maximum(jerk, 1e-300)) ** (2.0 / 3.0),
    ]
    return float(min(np.min(bound) for bound in bounds))
