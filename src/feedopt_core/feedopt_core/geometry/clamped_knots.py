"""NURBS curves whose knots are not clamped, as drawings hold them for closed curves."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from feedopt_core.arrays import FloatArray


def clamp_knots(
    degree: int, knots: FloatArray, control_points_mm: FloatArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same curve over its whole domain with clamped knots: it starts and ends at its outer control points.

    Args:
        degree: polynomial degree, at least 1.
        knots: shape (n + degree + 1,), not decreasing.
        control_points_mm: shape (n, dimensions).
        weights: shape (n,), above zero.

    Returns:
        Knots, control points and weights; the same ones where they are clamped already.

    Raises:
        ValueError: the counts do not fit, the knots decrease, or no continuous curve has such knots.
    """
    count = len(control_points_mm)
    if len(knots) != count + degree + 1 or len(weights) != count:
        raise ValueError(
            f"degree {degree} with {count} control points needs {count + degree + 1} knots and {count} weights, "
            f"there are {len(knots)} and {len(weights)}"
        )
    first, last = knots[degree], knots[count]
    if knots[0] == first and knots[-1] == last:
        return knots, control_points_mm, weights
    inner = knots[degree + 1 : count]
    clamped = np.concatenate([np.full(degree + 1, first), inner, np.full(degree + 1, last)])
    homogeneous = np.column_stack([control_points_mm * weights[:, None], weights])
    # Both knot vectors span the same splines, so interpolating at the Greville points gives the same curve.
    places = np.array([np.mean(clamped[index + 1 : index + degree + 1]) for index in range(count)])
    values = BSpline(knots, homogeneous, degree)(places)
    net = np.asarray(make_interp_spline(places, values, degree, t=clamped).c)
    return clamped, net[:, :-1] / net[:, -1:], net[:, -1]
